"""Ways to spoil exported files that share nothing with those that write or read them."""

import ctypes
import re
import struct
import zlib
from io import BytesIO

import cv2
import numpy as np
import pypdfium2 as pdfium
import pypdfium2.raw as raw


def rewritten(data, change):
    """A PDF with every page changed through PDFium."""
    document = pdfium.PdfDocument(data)
    for page in document:
        change(page)
        page.gen_content()
    out = BytesIO()
    document.save(out)
    document.close()
    return out.getvalue()


class Spoiler:
    """Spoils files of one marker, sheets of pixels at `dpi`."""

    def __init__(self, marker, dpi):
        self.marker, self.dpi = marker, dpi

    def scaled(self, data, suffix, x, y):
        """The same file with all its content x and y times as large."""
        return getattr(self, f"_{suffix[1:]}_mapped")(data, x, y)

    def mirrored(self, data, suffix):
        return getattr(self, f"_{suffix[1:]}_mapped")(data, -1.0, 1.0)

    def without(self, data, suffix, index):
        """The same file without one dot; all of it, if a ring."""
        return getattr(self, f"_{suffix[1:]}_without")(data, index)

    def _svg_mapped(self, data, x, y):
        text = data.decode()
        return (
            re.sub(r"(<svg[^>]*>)", rf'\1<g transform="scale({x},{y})">', text, count=1)
            .replace("</svg>", "</g></svg>")
            .encode()
        )

    def _svg_without(self, data, index):
        return re.sub(rf'<(circle|path) id="dot-{index}"[^>]*/>'.encode(), b"", data, count=1)

    def _pdf_streams(self, data, change):
        """The PDF with another content stream on every page, as an update behind the old file."""
        return rewritten(data, change)

    def _pdf_mapped(self, data, x, y):
        def change(page):
            for k in range(raw.FPDFPage_CountObjects(page)):
                raw.FPDFPageObj_Transform(raw.FPDFPage_GetObject(page, k), x, 0, 0, y, 0, 0)

        return self._pdf_streams(data, change)

    def _pdf_without(self, data, index):
        point = self.marker.control_points[index]

        def change(page):
            results = []
            for k in range(raw.FPDFPage_CountObjects(page)):
                item = raw.FPDFPage_GetObject(page, k)
                box = [ctypes.c_float() for _ in range(4)]
                raw.FPDFPageObj_GetBounds(item, *box)
                left, bottom, right, top = (value.value * 25.4 / 72 for value in box)
                if (
                    abs(right - left - 1e3 * point.feature.diameter) < 0.01
                    and abs(top - bottom - (right - left)) < 0.01
                ):
                    results.append(item)
            assert len(results) == len(self.marker)
            raw.FPDFPage_RemoveObject(page, results[index])

        return self._pdf_streams(data, change)

    def _dxf_mapped(self, data, x, y):
        """All coordinates times a factor; a circle that is no circle any more becomes an ellipse."""
        lines = data.decode().split("\n")
        start = lines.index("ENTITIES")
        for k in range(start + 1, len(lines) - 1, 2):
            code = lines[k].strip()
            factor = {"10": x, "11": x, "20": y, "21": y, "40": abs(x * y) ** 0.5}.get(code)
            if factor is not None:
                lines[k + 1] = repr(float(lines[k + 1]) * factor)
        return "\n".join(lines).encode()

    def _dxf_without(self, data, index):
        x = 1e3 * self.marker.control_points[index].x
        y = 1e3 * self.marker.control_points[index].y
        parts = data.decode().split("  0\nCIRCLE\n")
        kept = [parts[0]]
        for part in parts[1:]:
            body, mark, rest = part.partition("  0\n")
            at = dict(re.findall(r"^ ?(\d+)\n(\S+)$", body, re.MULTILINE))
            gone = abs(float(at["10"]) - x) < 1e-3 and abs(float(at["20"]) - y) < 1e-3
            kept.append(mark + rest if gone else "  0\nCIRCLE\n" + part)
        return "".join(kept).encode()

    def _png_mapped(self, data, x, y):
        grey = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
        height, width = grey.shape
        # Pixel k covers k to k + 1: a scale about the corner of the image is not one about the middle of pixel 0.
        matrix = np.array([[x, 0, (x - 1) / 2 + (width if x < 0 else 0)], [0, y, (y - 1) / 2]])
        return png(cv2.warpAffine(grey, matrix, (width, height), flags=cv2.INTER_CUBIC, borderValue=255), self.dpi)

    def _png_without(self, data, index):
        grey = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_GRAYSCALE)
        # The dots' places on the page, by a Hough transform of what is there; the nearest in the layout's order.
        scale = self.dpi / 25.4
        origin = self._origin(grey, scale)
        point = self.marker.control_points[index]
        center = origin + np.array([point.x, -point.y]) * 1e3 * scale
        cv2.circle(grey, tuple(int(v) for v in np.rint(center)), int(550 * point.feature.diameter * scale), 255, -1)
        return png(grey, self.dpi)

    def _origin(self, grey, scale):
        """Where in the image the marker's origin is: the middle of the dots is that of the layout."""
        size = 1e3 * self.marker.dot_diameter * scale
        _, _, stats, centers = cv2.connectedComponentsWithStats((grey < 128).astype(np.uint8))
        full = stats[:, 4] > 0.5 * size**2
        dots = centers[(np.abs(stats[:, 2] - size) < 3) & (np.abs(stats[:, 3] - size) < 3) & full]
        assert len(dots) == len(self.marker)
        middle = self.marker.xyz[:, :2].mean(axis=0) * 1e3 * scale
        return dots.mean(axis=0) - middle * [1, -1]


def png(grey, dpi):
    """A grey image as PNG with its resolution."""
    ok, data = cv2.imencode(".png", grey)
    assert ok
    data = data.tobytes()
    body = b"pHYs" + struct.pack(">IIB", round(dpi / 0.0254), round(dpi / 0.0254), 1)
    chunk = struct.pack(">I", 9) + body + struct.pack(">I", zlib.crc32(body))
    return data[:33] + chunk + data[33:]
