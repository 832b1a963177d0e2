"""The paper's claims with their tests, its sentences that state them, and the verdicts."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from markergen_paper import accuracy_tests as accuracy
from markergen_paper import layout_tests as layouts
from markergen_paper.results import SQUARE_LIKE, PaperResults
from markergen_paper.statistics import LEVEL, ClaimTest


@dataclass(frozen=True)
class Claim:
    """Claim of the paper, and its test.

    Attributes
    ----------
    name, words, test : str
        Short name, the claim in words, and the criterion.
    find : callable
        Takes the study and yields findings.
    """

    name: str
    words: str
    test: str
    find: Callable[[PaperResults], Iterator[ClaimTest]]


def verdict(findings: list[ClaimTest]) -> str:
    """``holds`` or ``does not hold`` if all tests agree, ``open`` if none is conclusive, otherwise their numbers."""
    held = sum(finding.judged.holds for finding in findings)
    refuted = sum(finding.judged.refuted for finding in findings)
    if len(findings) in (held, refuted):
        return "holds" if held else "does not hold"
    if not held + refuted:
        return "open"
    parts = {"holds": held, "does not": refuted, "open": len(findings) - held - refuted}
    return ", ".join(f"{outcome} in {count}" for outcome, count in parts.items() if count)


_POSES = f"Wilcoxon's signed-rank test over poses, p < {LEVEL:g}"
_TWO_SIDED = f"two one-sided signed-rank tests over poses, p < {LEVEL:g}"

CLAIMS = (
    Claim(
        "square",
        "With four points a square is the most common optimum, for all poses.",
        f"Square-like (corners off by less than {SQUARE_LIKE:.0%} of the size, RMS) more often than not: {_POSES} for "
        "all descents of a pose, binomial test for the best of each pose.",
        layouts.square,
    ),
    Claim(
        "perfect square",
        "A perfect square is hardly better than a square-like layout.",
        f"Ratio of the mean errors, square-like over perfect, within {accuracy.MARGIN:.0%} of 1: {_TWO_SIDED}.",
        accuracy.perfect_square,
    ),
    Claim(
        "square-like",
        "A square-like layout is far better than a random one.",
        f"Ratio of the mean errors, random over square-like, above {accuracy.RADICAL:g}: {_POSES}.",
        accuracy.square_like,
    ),
    Claim(
        "better than more",
        "Four optimized points are better than 5 to 9 random ones.",
        f"Ratio of the mean errors above 1: {_POSES}.",
        accuracy.better_than_more,
    ),
    Claim(
        "always better",
        "Four optimized points are always better than 5 to 9 random ones.",
        f"Smaller mean errors in more than {accuracy.ALWAYS:.0%} of the poses: binomial test, p < {LEVEL:g}. Less than "
        "240 poses can refute it, not confirm it.",
        accuracy.always_better,
    ),
    Claim(
        "more points",
        "More points are more accurate.",
        f"Mean errors fall with n = 4..8: Page's trend test over poses, p < {LEVEL:g}.",
        accuracy.more_points,
    ),
    Claim(
        "early",
        "The gain is largest in the first steps of the descent.",
        "More than half of the fall of the logarithm in the first fifth of the steps, mean of the descents of a pose "
        f"in which it fell: {_POSES}.",
        layouts.early,
    ),
    Claim(
        "settled",
        "The descents converge to a stable minimum.",
        f"c(A) ends within {layouts.SETTLED:.0%} of the best of the pose in more than half of the descents, by ours "
        f"and by SuperSAB as published, after 150 and after 700 steps: {_POSES}.",
        layouts.settled,
    ),
    Claim(
        "small n gains more",
        "The fewer points, the larger the gain.",
        f"Gain (error before over after) falls with n = 4..8: Page's trend test over poses, p < {LEVEL:g}.",
        accuracy.fewer_gain_more,
    ),
    Claim(
        "EPnP and IPPE gain more",
        "EPnP and IPPE gain more than LM.",
        f"Ratio of the gains above 1: {_POSES}.",
        accuracy.others_gain_more,
    ),
    Claim(
        "methods converge",
        "On optimized layouts EPnP and IPPE reach errors similar to LM's.",
        f"Ratio of the mean errors within {accuracy.SIMILAR:.0%} of 1: {_TWO_SIDED}.",
        accuracy.converge,
    ),
    Claim(
        "IPPE equals LM",
        "On optimized layouts there is almost no difference between IPPE and LM.",
        f"Ratio of the mean errors within {accuracy.MARGIN:.0%} of 1, over all poses, at each polar angle, and for "
        f"square-like layouts alone: {_TWO_SIDED}.",
        accuracy.equal,
    ),
    Claim(
        "LM is the most accurate",
        "LM is the most accurate method.",
        f"Ratio of the mean errors of EPnP and IPPE to LM's above 1, random and optimized layouts: {_POSES}.",
        accuracy.most_accurate,
    ),
    Claim(
        "initial guess",
        "LM gains on optimized layouts because its initial guess is better.",
        "Started from the true pose, LM gains less than half as much (logarithm of the error before over after): "
        f"{_POSES}.",
        accuracy.initial_guess,
    ),
    Claim(
        "good start",
        "LM requires a good initial guess.",
        "Ratio of the mean errors, LM from starts 45 degrees off over LM from the pose of the DLT's homography, above "
        f"1: {_POSES}.",
        accuracy.needs_a_start,
    ),
    Claim(
        "start of the DLT",
        "The DLT gives LM a good initial guess.",
        f"Ratio of the mean errors, LM from the pose of the DLT's homography over LM from the true pose, within "
        f"{accuracy.MARGIN:.0%} of 1: {_TWO_SIDED}.",
        accuracy.start_of_the_dlt,
    ),
    Claim(
        "decomposition",
        "Planar pose estimation is more accurate than the decomposition of a homography.",
        f"Ratio of the mean errors, pose nearest to the DLT's homography over IPPE and LM, above 1: {_POSES}.",
        accuracy.decomposed,
    ),
    Claim(
        "other DLTs",
        "The homographies of Harker & O'Leary and of OpenCV hardly differ from the DLT's.",
        f"Ratio of the mean HE within {accuracy.MARGIN:.0%} of 1: {_TWO_SIDED}.",
        accuracy.other_dlts,
    ),
    Claim(
        "Harker improves",
        "Harker & O'Leary's orthogonalization improves the homography.",
        f"Ratio of the mean HE, DLT over Harker & O'Leary, above 1: {_POSES}.",
        accuracy.orthogonalized,
    ),
    Claim(
        "normalization",
        "Normalization improves the homography.",
        f"Ratio of the mean HE, DLT in m and px over normalized DLT, above 1 for n = 5..8: {_POSES}. Four points give "
        "the same homography either way.",
        accuracy.normalized_dlt,
    ),
    Claim(
        "normalization improves c",
        "Normalization improves the condition of A.",
        f"c(A) of random layouts as written over that of normalized points above 1: {_POSES}.",
        layouts.normalized_condition,
    ),
    Claim(
        "steadier",
        "Mean and deviation of all errors fall.",
        f"Ratio of before to after above 1: {_POSES}.",
        accuracy.steadier,
    ),
    Claim(
        "any pose",
        "Optimized layouts do not depend on the pose.",
        f"Under all poses a layout loses less than {layouts.ANYWHERE:.0%}, on average, against those optimized for "
        f"them: {_POSES}.",
        layouts.any_pose,
    ),
    Claim(
        "some views are better",
        "Some poses of the camera are better for estimation than others.",
        f"LM's rotation error in frontal views over that at {accuracy.TILTED_DEG:g} degrees, from the same distance, "
        f"above 1: {_POSES}.",
        accuracy.views,
    ),
    Claim(
        "bounds",
        "c(A) |dA| / |A| is an upper bound of the homography's relative error under a disturbance dA.",
        "No error is beyond it, nor below the paper's lower bound |(A + dA)(h - h')| / (|A + dA| |h'|).",
        layouts.bounded,
    ),
    Claim(
        "c tells",
        "c(A) is a good objective: a layout of smaller c(A) is more accurate.",
        f"Spearman's rank correlation among random layouts above {layouts.MODERATE:g}: {_POSES}.",
        layouts.ranks,
    ),
    Claim(
        "c is optimal",
        "Minimizing c(A) is equivalent to minimizing the first-order error.",
        "Ratio of the mean errors, layouts of least c(A) over those of least first-order error (of the homography for "
        f"HE, of the pose for LM's rotation), within {accuracy.MARGIN:.0%} of 1: {_TWO_SIDED}.",
        accuracy.criterion,
    ),
    Claim(
        "symmetric",
        "Optimized layouts are symmetric.",
        f"Own mirror images, but for {SQUARE_LIKE:.0%} of the size, more often than not; nearer to it than random "
        f"ones: {_POSES}.",
        layouts.symmetric,
    ),
    Claim(
        "holds a square",
        "The corners of a square-like shape are also in optimized layouts of more points.",
        f"More common than in random layouts: {_POSES}.",
        layouts.subset,
    ),
    Claim(
        "apart",
        "The points move away from one another.",
        f"Ratio of their smallest distance after to before above 1: {_POSES}.",
        layouts.apart,
    ),
    Claim(
        "apart in the image",
        "The images of the points move away from one another.",
        f"Ratio of their smallest distance after to before above 1: {_POSES}.",
        layouts.apart_in_the_image,
    ),
    Claim(
        "rectangle",
        "The corners of a rectangular limit restrict the movement of the points.",
        "In a rectangle of the disk's area descents end farther above the best c(A) of their pose, and points move "
        f"less, ratios above 1: {_POSES}.",
        layouts.rectangle,
    ),
)
"""All claims."""
