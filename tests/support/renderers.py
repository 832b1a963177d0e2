"""One sheet drawn by independent programs: page sizes and positions of the dots."""

import subprocess
from pathlib import Path

import numpy as np
import pypdfium2
from PIL import Image
from programs import chromium

from markergen.drawing.paper import SheetOptions
from markergen.drawing.sheet_layout import pages_for
from markergen.exporters.formats.sheets import write_pdf, write_svg
from markergen.exporters.png import write_png

DPI = 300
MM = 25.4 / DPI


def run(*command: object) -> str:
    return subprocess.run(
        [str(part) for part in command], capture_output=True, check=True, text=True, timeout=120
    ).stdout


def by_pdfium(folder: Path) -> np.ndarray:
    """pdfium draws a page onto whole pixels and stretches it to fill them, which is undone here."""
    document = pypdfium2.PdfDocument(folder / "sheet.pdf")
    page = document[0].render(scale=DPI / 72).to_pil().convert("L")
    size = np.array(document[0].get_size()) * DPI / 72
    document.close()
    data = (page.width / size[0], 0, 0, 0, page.height / size[1], 0)
    return np.array(page.transform(page.size, Image.Transform.AFFINE, data, Image.Resampling.BICUBIC, fillcolor=255))


def by_poppler(folder: Path) -> np.ndarray:
    run("pdftocairo", "-png", "-singlefile", "-gray", "-r", DPI, folder / "sheet.pdf", folder / "poppler")
    return np.array(Image.open(folder / "poppler.png").convert("L"))


def by_ghostscript(folder: Path) -> np.ndarray:
    quiet = ("-q", "-dNOPAUSE", "-dBATCH", "-dSAFER")
    sampled = ("-sDEVICE=pnggray", "-dGraphicsAlphaBits=4", f"-r{DPI}")
    run("gs", *quiet, *sampled, f"-sOutputFile={folder / 'gs.png'}", folder / "sheet.pdf")
    return np.array(Image.open(folder / "gs.png").convert("L"))


def by_chromium(folder: Path) -> np.ndarray:
    """The SVG on a page without margins, at as many pixels to a CSS inch as make `DPI`."""
    (folder / "page.html").write_text(
        "<style>*{margin:0}img{display:block}</style><img src='sheet.svg'>", encoding="ascii"
    )
    size = 1200
    run(
        chromium(), "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
        "--hide-scrollbars", f"--user-data-dir={folder / 'profile'}", f"--force-device-scale-factor={DPI / 96}",
        f"--window-size={size},{size}", f"--screenshot={folder / 'chromium.png'}", (folder / "page.html").as_uri(),
    )  # fmt: skip
    return np.array(Image.open(folder / "chromium.png").convert("L"))


def by_markergen(folder: Path) -> np.ndarray:
    return np.array(Image.open(folder / "sheet.png").convert("L"))


RENDERERS = {
    "pdfium": by_pdfium,
    "png": by_markergen,
    "poppler": by_poppler,
    "ghostscript": by_ghostscript,
    "chromium": by_chromium,
}


def sheet_of(make_ngon):
    return pages_for([make_ngon(5, 0.08, 0.02)], SheetOptions(paper="letter"))[0]


def write_sheet(sheet, folder: Path) -> Path:
    (folder / "sheet.pdf").write_bytes(write_pdf([sheet]))
    (folder / "sheet.svg").write_bytes(write_svg(sheet))
    (folder / "sheet.png").write_bytes(write_png(sheet, DPI))
    return folder


def centers(image: np.ndarray, sheet) -> np.ndarray:
    """Centers (n, 2) of the dots in page mm, y up: of gravity of the ink in a window that nothing else is in."""
    ink, result = 255.0 - image, []
    for disk in sheet.scene["dots"]:
        half, row, column = 1.3 * disk.radius / MM, (sheet.paper.height - disk.y) / MM, disk.x / MM
        top, left = round(row - half), round(column - half)
        patch = ink[top : round(row + half), left : round(column + half)]
        rows, columns = np.indices(patch.shape) + 0.5
        middle = np.array([(patch * columns).sum(), (patch * rows).sum()]) / patch.sum() + [left, top]
        result.append([middle[0] * MM, sheet.paper.height - middle[1] * MM])
    return np.array(result)


def page_size(name: str, folder: Path) -> np.ndarray:
    """Width and height in mm that a program says the page has."""
    if name == "pdfium":
        document = pypdfium2.PdfDocument(folder / "sheet.pdf")
        size = np.array(document[0].get_size()) / 72 * 25.4
        document.close()
        return size
    if name == "poppler":
        phrase = run("pdfinfo", folder / "sheet.pdf").split("Page size:")[1].split()
        return np.array([float(phrase[0]), float(phrase[2])]) / 72 * 25.4
    if name == "ghostscript":
        # Of whole pixels, 0.085 mm each.
        return np.array(by_ghostscript(folder).shape[::-1]) * MM
    (folder / "size.html").write_text(
        "<style>*{margin:0}img{display:block}</style><img id='i' src='sheet.svg'><script>onload=()=>{"
        "let r=i.getBoundingClientRect();document.title=r.width+' '+r.height}</script>",
        encoding="ascii",
    )
    dump = run(
        chromium(), "--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking",
        f"--user-data-dir={folder / 'profile'}", "--dump-dom", (folder / "size.html").as_uri(),
    )  # fmt: skip
    return np.array(dump.split("<title>")[1].split("</title>")[0].split(), dtype=float) / 96 * 25.4
