"""A window that shows images as they come, made by Tk, since the OpenCV that is installed has none."""

import gc
import os
import sys
from time import monotonic
from typing import Any

import numpy as np
from numpy.typing import NDArray

from markergen.errors import InputError

SECONDS_BETWEEN, SHARE = 0.03, 0.25
"""Least time in s between images, and the share of all time that showing them may take: the rest is for the search."""

_REMEDY = "give --overlay out.mp4 to write a video, or --no-window"


def has_display() -> bool:
    """Return whether a window can be expected to open."""
    return bool(os.environ.get("DISPLAY")) if sys.platform.startswith("linux") else True


class Window:
    """A window, closed by q, Esc or its button; images larger than the screen are reduced.

    Raises
    ------
    InputError
        If there is no display, or Python has no Tk.
    """

    def __init__(self, title: str) -> None:
        no_display = InputError("a display for a window", "none", _REMEDY)
        if not has_display():
            raise no_display
        try:
            import tkinter
        except ImportError:
            raise InputError("a Python with Tk for a window", "none (python3-tk)", _REMEDY) from None
        try:
            self._root = tkinter.Tk()
        except tkinter.TclError:
            raise no_display from None
        self._photo: Any = None
        self._label = tkinter.Label(self._root, borderwidth=0)
        self._label.pack()
        self._next = -np.inf
        self.closed = False
        self._root.title(title)
        self._root.resizable(False, False)
        for key in ("q", "<Escape>"):
            self._root.bind(key, self._close)
        self._root.protocol("WM_DELETE_WINDOW", self._close)

    def show(self, image: NDArray[np.uint8]) -> None:
        """Show an image (h, w, 3), BGR, unless it comes too soon after the last one."""
        import tkinter

        import cv2

        start = monotonic()
        if not self.closed and start >= self._next:
            height, width = image.shape[:2]
            scale = min(
                1.0, 0.9 * self._root.winfo_screenwidth() / width, 0.9 * self._root.winfo_screenheight() / height
            )
            if scale < 1:
                image = np.asarray(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), np.uint8)
            header = f"P6 {image.shape[1]} {image.shape[0]} 255 ".encode()
            self._photo = tkinter.PhotoImage(data=header + image[..., ::-1].tobytes(), format="PPM", master=self._root)
            self._label.configure(image=self._photo)
            self._root.update()
            self._next = start + max(SECONDS_BETWEEN, (monotonic() - start) / SHARE)
        else:
            self._root.update()

    def close(self) -> None:
        """Close the window."""
        self._close()
        self._root.destroy()
        # Tcl ends the program if another thread collects what is left of the window.
        del self._photo, self._label, self._root
        gc.collect()

    def _close(self, _: object = None) -> None:
        self.closed = True
