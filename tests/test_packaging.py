"""What is built holds every tracked file, and importing it costs nothing."""

import tarfile
import zipfile

import pytest

import truemean


@pytest.fixture
def distributions(checkout, run, tmp_path):
    """The sdist of a clean checkout, and the wheel made from that sdist."""
    run("-m", "build", "--no-isolation", "--outdir", tmp_path / "dist", checkout)
    (sdist,) = (tmp_path / "dist").glob("*.tar.gz")
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    return tarfile.open(sdist), zipfile.ZipFile(wheel)


@pytest.mark.slow
def test_distributions_hold_every_tracked_file(distributions, package_files, root):
    sdist, wheel = distributions
    with sdist, wheel:
        assert {name for name in wheel.namelist() if ".dist-info/" not in name} == set(package_files)
        top = f"truemean-{truemean.__version__}"
        for installed, source in package_files.items():
            content = source.read_bytes()
            assert wheel.read(installed) == content, installed
            packed = sdist.extractfile(f"{top}/{source.relative_to(root).as_posix()}")
            assert packed is not None
            assert packed.read() == content, source
        assert {f"{top}/LICENSE", f"{top}/README.md", f"{top}/pyproject.toml"} <= set(sdist.getnames())
        assert not any(member.issym() or member.islnk() for member in sdist)
        assert not any(name.startswith(f"{top}/tests") for name in sdist.getnames())


@pytest.mark.slow
def test_metadata_says_version_command_and_licence(distributions):
    sdist, wheel = distributions
    with sdist, wheel:
        info = f"truemean-{truemean.__version__}.dist-info"
        metadata = wheel.read(f"{info}/METADATA").decode()
        assert "truemean = truemean.cli:main" in wheel.read(f"{info}/entry_points.txt").decode()
    lines = metadata.splitlines()
    assert f"Version: {truemean.__version__}" in lines
    assert "License-Expression: BSD-3-Clause" in lines
    assert "Requires-Python: >=3.11" in lines


def test_importing_truemean_loads_no_library(run, tmp_path):
    code = "import sys, truemean; print(*{name.partition('.')[0] for name in sys.modules})"
    loaded = set(run("-c", code, cwd=tmp_path).stdout.split())
    assert "truemean" in loaded
    assert not loaded & {"numpy", "scipy", "sympy", "mpmath", "flint", "matplotlib", "typer", "rich", "jinja2"}
