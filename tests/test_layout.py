"""One import name over three folders: with links, without, and with links that git wrote as text files."""

import json
import zipfile
from pathlib import Path

import pytest

LINKS = {folder: f"../../{folder}" for folder in ("oracle", "conformance", "adapters")}

IMPORT_ALL = """
import importlib, json, pkgutil, sys
import truemean
for module in pkgutil.walk_packages(truemean.__path__, "truemean."):
    importlib.import_module(module.name)
loaded = {name: getattr(module, "__file__", None) for name, module in sys.modules.items()}
print(json.dumps(loaded))
"""


def keep(link: Path, target: str) -> None:
    assert link.readlink() == Path(target)


def remove(link: Path, target: str) -> None:
    link.unlink()


def flatten(link: Path, target: str) -> None:
    link.unlink()
    link.write_text(target)


@pytest.fixture(params=[keep, remove, flatten], ids=["links", "no links", "links as text"])
def variant(request, checkout):
    """A checkout whose links are what this system made of them."""
    for folder, target in LINKS.items():
        request.param(checkout / "src" / "truemean" / folder, target)
    return checkout


def modules(package_files):
    """The dotted names that the files of the package should have."""
    names = (name.removesuffix(".py").removesuffix("/__init__") for name in package_files if name.endswith(".py"))
    return {name.replace("/", ".") for name in names}


@pytest.mark.slow
def test_every_module_imports_from_a_checkout(variant, package_files, run, tmp_path):
    loaded = json.loads(run("-c", IMPORT_ALL, cwd=tmp_path, path=variant / "src").stdout)
    ours = {name: Path(file) for name, file in loaded.items() if name.partition(".")[0] == "truemean"}
    assert set(ours) == modules(package_files)
    assert all(file.resolve().is_relative_to(variant.resolve()) for file in ours.values())


@pytest.mark.slow
def test_every_checkout_builds_the_whole_wheel(variant, package_files, run, tmp_path):
    run("-m", "build", "--wheel", "--no-isolation", "--outdir", tmp_path, variant, cwd=tmp_path)
    (wheel,) = tmp_path.glob("*.whl")
    names = {name for name in zipfile.ZipFile(wheel).namelist() if ".dist-info/" not in name}
    assert names == set(package_files)


@pytest.mark.slow
def test_an_editable_install_serves_every_checkout(variant, package_files, run, tmp_path):
    site = tmp_path / "site"
    install = ["pip", "install", "--no-deps", "--no-build-isolation", "--no-index", "--quiet", "--target"]
    run("-m", *install, site, "--editable", variant, cwd=tmp_path)
    code = f"import site, sys; sys.path.remove({str(site)!r}); site.addsitedir({str(site)!r})" + IMPORT_ALL
    loaded = json.loads(run("-c", code, cwd=tmp_path, path=site).stdout)
    assert modules(package_files) <= set(loaded)
    assert Path(loaded["truemean.oracle.pixel"]).resolve() == (variant / "oracle" / "pixel.py").resolve()


def test_this_checkout_has_relative_links(root):
    for folder, target in LINKS.items():
        link = root / "src" / "truemean" / folder
        found = link.readlink().as_posix() if link.is_symlink() else link.read_text() if link.is_file() else target
        assert found == target


@pytest.mark.slow
def test_no_module_is_loaded_under_a_second_name(root, run):
    """With the repository as cwd ``import oracle`` would work, and make a second copy of every class."""
    loaded = json.loads(run("-c", IMPORT_ALL, cwd=root).stdout)
    assert not {name for name in loaded if name.partition(".")[0] in LINKS}
