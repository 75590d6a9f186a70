"""Renders and files of renders that tests write."""

from __future__ import annotations

import numpy as np
import pytest

EXTRA = "needs the extra: pip install 'truemean[images]'"


def rendered(scene, count, samples=16, seed=1):
    """Renders ``[count, height, width(, channels)]`` with independent samples in each pixel."""
    rng = np.random.default_rng(seed)
    rows = [[] for _ in range(scene.height)]
    for (_, y), X in scene.pixels().items():
        values, weights = X.arrays()
        rows[y].append(rng.choice(values, size=(count, samples), p=weights).mean(axis=1))
    return np.moveaxis(np.array(rows), 2, 0)


def write_pfm(path, image, order="<"):
    mark = "PF" if image.ndim == 3 else "Pf"
    scale = -1.0 if order == "<" else 1.0
    head = f"{mark}\n{image.shape[1]} {image.shape[0]}\n{scale}\n".encode()
    path.write_bytes(head + image[::-1].astype(f"{order}f4").tobytes())


def write_pnm(path, codes, most, head=b"# a comment\n"):
    mark = b"P6\n" if codes.ndim == 3 else b"P5\n"
    size = b"%d # width\n %d\n%d\n" % (codes.shape[1], codes.shape[0], most)
    path.write_bytes(mark + head + size + codes.astype(">u2" if most > 255 else "u1").tobytes())


def write_png(path, codes):
    png = pytest.importorskip("png", reason=EXTRA)
    mode = {2: "L", 3: "RGB", 4: "RGBA"}[codes.shape[2] if codes.ndim == 3 else 2]
    png.from_array(codes.reshape(len(codes), -1).tolist(), f"{mode};{8 * codes.itemsize}").save(path)


def write_exr(path, **channels):
    library = pytest.importorskip("OpenEXR", reason=EXTRA)
    planes = {name.replace("_", "."): np.ascontiguousarray(plane) for name, plane in channels.items()}
    library.File({"type": library.scanlineimage}, planes).write(str(path))


def save(directory, images, write=lambda path, image: np.save(path, image.astype(np.float32)), suffix="npy"):
    directory.mkdir()
    for number, image in enumerate(images):
        write(directory / f"r{number:04}.{suffix}", image)
    return directory
