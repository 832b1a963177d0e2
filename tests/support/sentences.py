"""The sentences that tests know, once each: a rewording is one edit here.

A test names a sentence by its key and gives what stands in its gaps, so that it asserts facts: which dot, how far off.
"""

import re

SENTENCES = {
    # Findings of verify
    "dot off": "dot {} is {} off",
    "dot too high": "{} {} too high",
    "dot too low": "dot {} is {} too low",
    "dot for ring": "dot {} is a dot, not a ring",
    "ring for dot": "dot {} is a ring, not a dot",
    "no inlay": "dot {} has no inlay: its pocket is empty",
    "diameter": "has a diameter of {}, not {}",
    "scaled": "scaled by {}",
    "unit": "scaled by {} along x, y and z: {} taken for {}",
    "hole missing": "the hole {} at {} is missing",
    "hole off": "the hole {} at {} is {} off",
    "hole extra": "a hole at {} that the marker does not have",
    "tag missing": "the tag {} is not in its place",
    "same color": "dots and plate have the same color",
    "open edges": "has open edges: it encloses no volume",
    "plate off": "plate {} is {} off ({}), in its own frame",
    "plate turned": "plate {} is turned by {} degrees about {}, in its own frame",
    "plates swapped": "plate {} and plate {} are swapped",
    "plate missing": "plate {} is missing: its {} dots are not there",
    "plate unprinted": "plate {} is missing: it is on no page",
    "no plate": "no marker of the rig is in it",
    # Notes of verify
    "plate thickness": "the plate is {} thick, where marker.json says {}",
    "tag alone": "it holds the tag alone, and no dots",
    "recesses": "recesses for printed dots with {} of room around them, and no dots",
    # Verdicts of calibrate
    "use measured": "Use the measured marker",
    "not yet": "Keep the marker as designed: left-out photographs are predicted",
    "no better": "does not predict left-out photographs significantly better than {}",
    "few photographs": "{} photographs are too few for leaving some out",
    "one photograph": "one photograph is too few for leaving some out",
    "variance left": "The variance that is left comes from image noise ({}), the print ({}).",
    "scale doubted": "no better than a print is expected to be",
    "weak heights": "heights of the dots",
    "weak depths": "depths of the dots",
    "weak scale": "scale of the print",
    "weak focal length": "focal length against distance",
    "hold turned": "hold the camera square to the marker, turn the camera by {} "
    "(dot {} at the top of the picture), and fill the picture",
    # Last lines of calibrate
    "unusable result": "the result is not to be used yet: see the first line",
    "unusable files": "{}: written, but not to be used yet: see the first line",
    "nothing written": "nothing was written: add -o measured.json",
    # What validate finds
    "limits": "{} limits the {}",
    "limits both": ", {} limits the rotation and the translation: {}.",
    "nothing else": "Improving the rest would gain next to nothing.",
    "shares": "print {} %, image noise {} %, calibration {} %",
    "smallest dot": "At {} and {} the dot that looks smallest, of {}, is {}",
    "seen frontally": "Seen frontally, a small tilt hardly changes the image.",
    "rings and disks": "Rings are distinguished from disks by their looks (here dot {})",
    "never alike": "never: no other dot is like it",
    "views found": "Found in {} of {} views, none with a wrong label.",
    # Detection
    "markers found": "found a marker in {}",
    "video left out": "1 video is left out: give one at a time",
    "HEIC file": "1 HEIC file is not read: set the phone to JPEG, or convert it",
    "HEIC files": "{} HEIC files are not read: set the phone to JPEG, or convert them",
    # Refusals and warnings that several commands share
    "no option": "expected options of markergen.{}, found {}",
    "no rig suffix": "output suffix for a rig",
    "input overwritten": "one of the inputs",
    "edge on polygon": "an edge around a disk or a rectangle only",
    "keep-out outside": "keep-out {}, a disk of radius {} around ({}), lies wholly outside the boundary",
    "install solids": "pip install ./detector '.[step]' && apt-get install libgl1 libx11-6",
    "study there": "expected a new or empty folder, found this study, started in {}; continue it with --resume",
    "disk full": "No space left on device; finished cells remain: make room, and use --resume",
    # What markers, boundaries and plates are called
    "marker": "Marker({} control points in a disk of radius 150 mm{})",
    "polygon": "polygon of {} with {}",
    "polygon of": "polygon of {}",
    "rectangle of": "rectangle of {}",
    "disk": "disk of radius {}",
    "camera": "{}, fx {}, fy {}, cx {}, cy {}, no distortion",
    "image noise": "blur {} px, noise {} and contrast {} grey levels",
    "hole": "the hole {} at {}",
    "dowel": "the dowel hole {} at {}",
    "drawn hole": "the drawn hole around {}",
    "quiet zone": "the quiet zone of the tag",
    "origin of circle": "center of the boundary's smallest enclosing circle",
    "origin of drawing": "that of the boundary's drawing",
    # Refusals of marker.json and of plates
    "over": "{}: stands {} over the {}",
    "too near": "{}: {} nearer to {} than the clearance",
    "newer version": "found version 3, written by a newer markergen{}; update",
    "hole too near": "is {} from {} instead of {} (move it by {}, or use",
    "larger plate": "use a larger {} smaller --corner-radius and --chamfer",
    "no string": "{}: Input should be a valid string",
    "no pose file": "a readable file of poses",
    "unseen": "{} behind the camera, {} from the back, {} outside the image",
    "seen if": "100 % would see it if the file {}: look up which way its format goes",
    "print scale": "The print is {} % of the design along x",
    # Drawings of outlines
    "gap": "a gap of {} between ({}) and ({})",
    "ends meet": "three or more ends at ({})",
    "no block": "INSERT of '{}', which is missing",
    "no unit": "none: the drawing is {} units across",
    # What cannot be made
    "thin plate": "a plate of at least {} for inlays {} deep",
    "thin wall": "expected a wall of at least {} between {}, found {}; {}",
    "small": "a diameter of at least {} for {}, made with a {} of {}",
    "overlap": "the plates of {} overlap by {}",
    "pillar and": "between the pillar of dot-{} and the {}",
    "pillar hides": "the pillar of dot-{} hiding some of dot-{} in 1 of {} poses",
    "back full": "The back has no room for: {}.",
    "back thin": "The back is not engraved: a plate of {} is thinner than {}.",
    "drawn as designed": "Drawn as designed: --compensate is for sheets.",
    # What design expects
    "layout title": "What the layout allows, for image noise of {}",
    "mean hidden": "mean of any {} hidden",
    "worst hidden": "worst: {} hidden",
    "noise of": "image noise of {}",
    "print error": " and a print error of {}",
    "for noise": " for image noise{}: larger",
    "tell apart": "; use --tag, fewer dots, more room or smaller --dot",
    "labels safe": "labels are safe: no two dots are alike",
    "exchanged": "each of {} taken for the next and {} and {} exchanged",
    "many exchanged": "{} dots taken for each other, 0 for 1 among them",
    "no room for": "expected room for the layout {}, found that its dots would touch",
    # Sheets and files
    "needs paper": "The marker needs {}: its {}.",
    "stands on": "The marker stands on {}: its disk is {} across",
    "page holds": "a page of {} holds a disk of radius {} mm: design it with --radius {}mm.",
    "page has room": "a page of {} has room for an outline of {}.",
    "print on one": "To print it on one: use --paper {}; {}",
    "no paper": "The disk of the marker is {} across. No paper up to A0 holds it, so it goes on {}",
    "one page": "{} markers stand on one page of {}.",
    "svg page": "A .svg file has one page; a .pdf fills pages of {}, or of another --paper.",
    "distance": "dots {} and {}: {} ({} over the outer edges)",
    "frame": "Frame: the marker's, x right, y up, z out of the printed face",
    "other colors": "the dots are {} in marker.json, and {} on the sheet, where markergen detect does not find them",
    "holes near dots": "holes reach into the quiet zones of dots, where a camera sees them as dark spots",
    # Detection
    "repeats": "this layout repeats under {} deg",
    "turned": "or turned by {} deg",
    "inconsistent": "; inconsistent: residuals are",
    "cut": "the search was cut before its end",
    # Comparisons
    "tags of": "tags of {} % of that",
    "needs peer": "needs stag-python: pip install ./detector '.[peers]'",
    # The studio
    "near edge": "too near to the edge of the room, or beyond it",
    "near region": "too near to a region without dots, or in it",
    "dots near": "Dots {} and {} are {} too near to each other.",
    "a unit": "a unit of length in {}",
    "field": "{} of dot {} in mm",
    "cross": "The cross is at {}.",
    "stopped": "Stopped; the dots are as they were before the search.",
    "no answer": "The studio does not answer.",
}
"""By key; a gap is {}."""


def sentence(key: str, *facts: object) -> str:
    """Return a sentence with its gaps filled.

    >>> sentence("dot off", 3, "0.2 mm")
    'dot 3 is 0.2 mm off'
    """
    return SENTENCES[key].format(*facts)


def pattern(key: str, *facts: object) -> str:
    """Return a regular expression for a sentence, with expressions in its gaps."""
    return re.escape(SENTENCES[key]).replace(r"\{\}", "{}").format(*facts)
