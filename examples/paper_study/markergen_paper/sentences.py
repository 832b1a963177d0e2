"""The paper's sentences that claim something, in its order; each has tests, or a reason for having none."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Sentence:
    """Statement of the paper.

    Attributes
    ----------
    section, words : str
        Where it stands, and its decisive words.
    claims : tuple of str
        Names of the claims that test it.
    reason : str
        Why there is no test.
    """

    section: str
    words: str
    claims: tuple[str, ...] = ()
    reason: str = ""


_OTHERS = "it reports what others found"
_FOOTNOTE = "the paper's footnote, that the two hardly differ, is tested below"

SENTENCES = (
    Sentence("abstract", "equivalent to minimizing the condition number", ("c is optimal",)),
    Sentence("abstract", "increase the performance of the DLT homography estimation", ("steadier",)),
    Sentence("abstract", "improve the performance of planar pose estimation methods like IPPE and EPnP", ("steadier",)),
    Sentence("abstract", "which is the most accurate algorithm", ("LM is the most accurate",)),
    Sentence("abstract", "practically independent on the camera pose", ("any pose",)),
    Sentence("abstract", "form certain symmetric patterns", ("symmetric",)),
    Sentence(
        "abstract",
        "characteristics of stable control point configurations",
        (
            "symmetric",
            "any pose",
        ),
    ),
    Sentence(
        "I",
        "control point configurations are relevant and they do influence the accuracy",
        (
            "c tells",
            "steadier",
        ),
    ),
    Sentence("I", "increasing the number of control points increases the accuracy", ("more points",)),
    Sentence("I", "normalization has already shown to improve the estimation", ("normalization",)),
    Sentence(
        "I",
        "the stepwise improvement of the accuracy of the pose estimate",
        (
            "early",
            "steadier",
        ),
    ),
    Sentence("I", "converging to stable control point configurations", ("settled",)),
    Sentence("II", "an over-constrained (only for n >= 3) and generic solution", reason="it is a definition"),
    Sentence("II", "in general provide four solutions", reason="it is about three points"),
    Sentence("II", "pose accuracy usually increases with the number of points", ("more points",)),
    Sentence("II", "return only a single pose solution, which might not be the true one", reason=_OTHERS),
    Sentence("II", "can only guarantee a local minimum", reason=_OTHERS),
    Sentence("II", "rather slow, neither convergence nor optimality can be guaranteed", reason=_OTHERS),
    Sentence("II", "a good initial guess is usually needed to converge to the right solution", ("good start",)),
    Sentence(
        "II",
        "early non-iterative solvers were also computational demanding and worse for a larger number of points",
        reason="those solvers are not in the study",
    ),
    Sentence("II", "the first efficient and non-iterative O(n) solution", reason="it is history"),
    Sentence(
        "II",
        "later improved by using an iterative method to increase accuracy",
        reason="EPnP is tested as the paper used it",
    ),
    Sentence("II", "outperform the best homography decomposition methods when noise is present", ("decomposition",)),
    Sentence("II", "only provide a single solution", reason="so they are defined"),
    Sentence("II", "improved later ... using an orthogonalization step", reason=_FOOTNOTE),
    Sentence("II", "a key step to improve the quality of the estimated homography", ("normalization",)),
    Sentence("II", "the normalization has some disadvantages", reason="no outliers are simulated"),
    Sentence("II-A", "have an influence on the local minima of the PnP problem", reason=_OTHERS),
    Sentence("II-A", "the stability of the compared methods greatly degrades", reason="all cameras look at the center"),
    Sentence("II-A", "decreases if the points are uniformly sampled", ("square-like", "steadier")),
    Sentence("II-A", "selecting the corners of the region as the positions", reason=_OTHERS),
    Sentence("II-A", "dependent on the singular values of the A matrix", ("bounds", "c tells")),
    Sentence("II-A", "some poses of the camera are more stable", ("some views are better",)),
    Sentence(
        "III-A", "the most accurate pose estimation results in the literature so far", ("LM is the most accurate",)
    ),
    Sentence("III-B", "the golden standard for non-iterative pose estimation", reason="it is a judgment"),
    Sentence("IV", "optimal for planar pose estimation using the (normalized) DLT algorithm", ("c is optimal",)),
    Sentence("IV", "requires a good initial guess, which is obtained from the DLT", ("good start", "start of the DLT")),
    Sentence("IV", "small singular values ... cause the estimation ... to be extremely sensitive", ("c tells",)),
    Sentence("IV", "the smaller the singular value spectrum, the less perturbed the estimation is", ("c tells",)),
    Sentence(
        "IV",
        "which is minimal if the singular value spectrum is minimal",
        reason="it is not so: a factor on A changes the difference s1 - s8, and not the ratio c(A)",
    ),
    Sentence("IV", "improve the condition of matrix A", ("normalization improves c",)),
    Sentence("IV", "defines an upper bound for the relative error", ("bounds",)),
    Sentence("IV", "leads to a lower bound of the relative error", ("bounds",)),
    Sentence(
        "IV",
        "there are only two ways to improve the maximum values of the relative error",
        reason="it follows from the bound, as far as errors come near it",
    ),
    Sentence("V", "the discontinuities on the corners restrict the movement of the points", ("rectangle",)),
    Sentence("V", "without lack of generality", reason="it describes the setting, which is the same here"),
    Sentence("V-A", "almost do not differ for low point configurations to the DLT", ("other DLTs",)),
    Sentence("V-A", "decreases drastically in the first iterations", ("early",)),
    Sentence("V-A", "mean and standard deviation ... is also reduced", ("steadier",)),
    Sentence(
        "V-A",
        "measure how good ... is able to represent the true homography beyond the space of the control points",
        reason="it is a definition; HE is measured so here",
    ),
    Sentence("V-A", "slowly and smoothly converge to a stable minimum value", ("settled",)),
    Sentence("V-A", "some point configurations increase the accuracy", ("c tells", "steadier")),
    Sentence("V-B", "a strong effect on the accuracy of homography and planar PnP methods", ("c tells", "steadier")),
    Sentence("V-B", "optimized configurations which are better than random", ("steadier",)),
    Sentence("V-B", "a square-like shape is the most common minima", ("square",)),
    Sentence("V-B", "a very stable and robust configuration for all camera poses", ("any pose", "square")),
    Sentence("V-B", "the corners of a square-like shape are common", ("holds a square",)),
    Sentence("V-B", "do not show any strong dependency with the pose of the camera", ("any pose",)),
    Sentence(
        "V-B",
        "mainly related to the distribution of the points in camera image coordinates",
        (
            "apart",
            "any pose",
        ),
    ),
    Sentence("V-B", "they tend to increase the distance to each other", ("apart",)),
    Sentence("V-B", "on the first iterations ... the increase in accuracy is stronger", ("early",)),
    Sentence("V-B", "the condition number is a good optimization objective", ("c tells", "c is optimal")),
    Sentence("V-B", "from a square-like configuration to a perfect square is very small", ("perfect square",)),
    Sentence("V-B", "from random points to the square-like shapes ... is radical", ("square-like",)),
    Sentence("V-B", "the smaller the number ... the more is the relative improvement", ("small n gains more",)),
    Sentence("V-B", "always better than random point configurations with more points", ("always better",)),
    Sentence("V-B", "more effect on the accuracy than the number of control points", ("better than more",)),
    Sentence("V-B", "more pronounced than for LM", ("EPnP and IPPE gain more",)),
    Sentence(
        "V-B",
        "take considerable less computation time",
        reason="times are of programs and machines; `python -m benchmarks.trials` measures ours",
    ),
    Sentence("V-B", "the methods converge to similar error values", ("methods converge",)),
    Sentence("V-B", "both mean and variance are reduced", ("steadier",)),
    Sentence("V-B", "can be used for fair comparison", reason="it is a judgment"),
    Sentence("V-B", "LM also has increased accuracy", ("steadier",)),
    Sentence("V-B", "the importance of having a good initial guess", ("initial guess",)),
    Sentence(
        "V-B",
        "the results of the real experiment closely match the simulations",
        reason="there is no camera here: the experiment's camera was simulated, with the same Gaussian noise",
    ),
    Sentence(
        "VI", "the lower the number ... the more the point configuration has an influence", ("small n gains more",)
    ),
    Sentence("VI", "a square is a very stable and robust configuration for all camera poses", ("any pose", "square")),
    Sentence("VI", "driven to distribute in space", ("apart",)),
    Sentence("VI", "includes the optimized 4 point configuration as a subset", ("holds a square",)),
    Sentence("VI", "almost no difference in accuracy between IPPE and LM", ("IPPE equals LM",)),
)
"""All of them, numbered from 1."""
