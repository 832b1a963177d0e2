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
_LITERATURE = "it is about the literature"
_DEFINITION = "it is a definition"
_DERIVATION = "it is a derivation"
_JUDGMENT = "it is a judgment"
_SETTING = "it describes the setting, which is the same here"
_ABSENT = "those solvers are not in the study"

SENTENCES = (
    Sentence("abstract", "We find robust configurations of control points", ("steadier",)),
    Sentence("abstract", "equivalent to minimizing the condition number", ("c is optimal",)),
    Sentence("abstract", "increase the performance of the DLT homography estimation", ("steadier",)),
    Sentence("abstract", "improve the performance of planar pose estimation methods like IPPE and EPnP", ("steadier",)),
    Sentence("abstract", "including the iterative minimization of the reprojection error", ("steadier",)),
    Sentence("abstract", "which is the most accurate algorithm", ("LM is the most accurate",)),
    Sentence("abstract", "characteristics of stable control point configurations", ("symmetric", "any pose")),
    Sentence("abstract", "for real-world noisy camera data", reason="there is no camera here: noise is simulated"),
    Sentence("abstract", "practically independent on the camera pose", ("any pose",)),
    Sentence("abstract", "form certain symmetric patterns", ("symmetric",)),
    Sentence(
        "abstract",
        "a comparison of optimized configuration versus the number of control points",
        ("better than more", "small n gains more"),
    ),
    Sentence("I", "a surprising lack of information", reason=_LITERATURE),
    Sentence(
        "I", "control point configurations are relevant and they do influence the accuracy", ("c tells", "steadier")
    ),
    Sentence("I", "the findings are rather general", reason=_LITERATURE),
    Sentence("I", "increasing the number of control points increases the accuracy", ("more points",)),
    Sentence(
        "I",
        "singularities or degenerate cases for certain estimation methods",
        reason="layouts here are planar, and seen centered",
    ),
    Sentence("I", "there is a need at least to find out which point configurations are better", reason=_JUDGMENT),
    Sentence("I", "normalization has already shown to improve the estimation", ("normalization",)),
    Sentence("I", "it is related to the condition number of the set of DLT equations", ("normalization improves c",)),
    Sentence("I", "The only error analysis for homography estimation found so far", reason=_LITERATURE),
    Sentence(
        "I", "results in improved pose estimations (from red to green) close to the true camera pose", ("steadier",)
    ),
    Sentence("I", "none of the above give an answer to the question", reason=_LITERATURE),
    Sentence("I", "the stepwise improvement of the accuracy of the pose estimate", ("early", "steadier")),
    Sentence("I", "converging to stable control point configurations", ("settled",)),
    Sentence("II", "an over-constrained (only for n >= 3) and generic solution", reason=_DEFINITION),
    Sentence("II", "in general provide four solutions", reason="it is about three points"),
    Sentence(
        "II", "prior knowledge has to be included to choose the correct solution", reason="it is about three points"
    ),
    Sentence("II", "pose accuracy usually increases with the number of points", ("more points",)),
    Sentence("II", "formulate the problem as a non-linear least-squares problem", reason=_DEFINITION),
    Sentence("II", "return only a single pose solution, which might not be the true one", reason=_OTHERS),
    Sentence("II", "can only guarantee a local minimum", reason=_OTHERS),
    Sentence("II", "the ones that find a global minimum remain computational intensive", reason=_ABSENT),
    Sentence("II", "rather slow, neither convergence nor optimality can be guaranteed", reason=_OTHERS),
    Sentence("II", "a good initial guess is usually needed to converge to the right solution", ("good start",)),
    Sentence(
        "II",
        "early non-iterative solvers were also computational demanding and worse for a larger number of points",
        reason=_ABSENT,
    ),
    Sentence("II", "The first efficient and non-iterative O(n) solution", reason="it is history"),
    Sentence(
        "II",
        "later improved by using an iterative method to increase accuracy",
        reason="EPnP without that step is not in the study",
    ),
    Sentence("II", "linear performance without the problems of EPnP and with higher accuracy", reason=_ABSENT),
    Sentence(
        "II",
        "can be solved by calculating the object-plane to image-plane homography transformation",
        reason="it is a method, compared with others below",
    ),
    Sentence("II", "Some of the most important planar PnP methods are the iterative", reason=_JUDGMENT),
    Sentence("II", "outperform the best homography decomposition methods when noise is present", ("decomposition",)),
    Sentence("II", "only provide a single solution", reason="so they are defined"),
    Sentence(
        "II",
        "The standard linear algorithm for homography estimation is the Direct Linear Transform (DLT)",
        reason=_JUDGMENT,
    ),
    Sentence("II", "improved later ... using an orthogonalization step", ("Harker improves",)),
    Sentence("II", "a key step to improve the quality of the estimated homography", ("normalization",)),
    Sentence("II", "the normalization has some disadvantages", reason="no outliers are simulated"),
    Sentence("II", "the noise affecting each point is independent of the others", reason="noise is simulated so"),
    Sentence("II-A", "have an influence on the local minima of the PnP problem", reason=_OTHERS),
    Sentence(
        "II-A", "a broad classification of the control points configurations into three groups", reason=_DEFINITION
    ),
    Sentence("II-A", "the stability of the compared methods greatly degrades", reason="all cameras look at the center"),
    Sentence("II-A", "is a configuration that lays between the ordinary 3D case and the planar case", reason=_OTHERS),
    Sentence(
        "II-A",
        "Some assumptions about the influence of the control points configurations are also present",
        reason=_OTHERS,
    ),
    Sentence("II-A", "decreases if the points are uniformly sampled", ("square-like", "steadier")),
    Sentence("II-A", "selecting the corners of the region as the positions", reason=_OTHERS),
    Sentence("II-A", "dependent on the singular values of the A matrix", ("bounds", "c tells")),
    Sentence("II-A", "characterizing pose-dependent offsets and uncertainty", reason=_OTHERS),
    Sentence("II-A", "some poses of the camera are more stable", ("some views are better",)),
    Sentence("III", "the golden standard optimization methods", reason=_JUDGMENT),
    Sentence("III-A", "the relation between these points is given by the relative pose", reason=_DEFINITION),
    Sentence(
        "III-A", "the most accurate pose estimation results in the literature so far", ("LM is the most accurate",)
    ),
    Sentence("III-B", "leads to an homography mapping", reason=_DERIVATION),
    Sentence("III-B", "produces two linearly independent equations", reason=_DERIVATION),
    Sentence("III-B", "the total number of degrees of freedom is 8", reason=_DERIVATION),
    Sentence("III-B", "is equivalent to the solution of ... and is given by the DLT algorithm", reason=_DERIVATION),
    Sentence("III-B", "the golden standard for non-iterative pose estimation", reason=_JUDGMENT),
    Sentence(
        "III-B",
        "serves as a basis for other non-iterative as well as iterative pose estimation methods",
        reason=_JUDGMENT,
    ),
    Sentence("IV", "optimal for planar pose estimation using the (normalized) DLT algorithm", ("c is optimal",)),
    Sentence(
        "IV",
        "the critical first step in planar pose estimation methods",
        reason="it is about how methods are built: EPnP takes no homography, and IPPE's is Harker's",
    ),
    Sentence("IV", "requires a good initial guess, which is obtained from the DLT", ("good start", "start of the DLT")),
    Sentence(
        "IV",
        "is perturbed by the second term",
        reason="it is a published expansion; its first-order error is minimized for *c is optimal*",
    ),
    Sentence("IV", "the influence of the measurement errors", reason=_DEFINITION),
    Sentence("IV", "can give us very large weights ... and dominate the error", reason="it follows from the expansion"),
    Sentence("IV", "small singular values ... cause the estimation ... to be extremely sensitive", ("c tells",)),
    Sentence(
        "IV",
        "The smaller the singular value spectrum, the less perturbed the estimation is",
        reason="a factor on A changes s1 - s8, which is meant, and not h; of the ratio c(A) *c tells*",
    ),
    Sentence(
        "IV", "the ratio between the largest and, in our case, second-smallest singular value", reason=_DEFINITION
    ),
    Sentence(
        "IV",
        "which is minimal if the singular value spectrum is minimal",
        reason="it is not so: a factor on A changes the difference s1 - s8, and not the ratio c(A)",
    ),
    Sentence("IV", "improve the condition of matrix A", ("normalization improves c",)),
    Sentence("IV", "adapted using SuperSAB", reason="it is a method, the one of *settled*"),
    Sentence("IV", "can now be used to find optimal control point configurations", ("settled", "c is optimal")),
    Sentence("IV", "defines an upper bound for the relative error", ("bounds",)),
    Sentence("IV", "leads to a lower bound of the relative error", ("bounds",)),
    Sentence(
        "IV",
        "there are only two ways to improve the maximum values of the relative error",
        reason="it follows from the bound, as far as errors come near it",
    ),
    Sentence("IV", "which usually can't be controlled", reason=_JUDGMENT),
    Sentence("IV", "can be done by a normalization step in the DLT transform", ("normalization improves c",)),
    Sentence(
        "IV",
        "by selecting optimized control point configurations",
        reason="it is so by construction: c(A) is what the descent reduces",
    ),
    Sentence("V", "allows a smooth movement of the control points during the optimization", ("rectangle",)),
    Sentence("V", "keeping them inside camera image", reason=_SETTING),
    Sentence("V", "the discontinuities on the corners restrict the movement of the points", ("rectangle",)),
    Sentence("V", "A uniform distribution of 400 camera poses", reason=_SETTING),
    Sentence("V", "without lack of generalization", reason=_SETTING),
    Sentence("V", "properly compare the final point configurations in image coordinates", reason=_JUDGMENT),
    Sentence("V", "keeping the complete circular plane in field of view", reason=_SETTING),
    Sentence(
        "V-A",
        "measure how good ... is able to represent the true homography ... beyond the space of the control points",
        reason="it is a definition; HE is measured so here",
    ),
    Sentence("V-A", "an improved set of control points", reason="it describes the method; its steps are tested below"),
    Sentence(
        "V-A",
        "a statistically meaningful measure of the homography estimation robustness against noise",
        reason="it describes the setting; the number of runs is an option here",
    ),
    Sentence("V-A", "almost do not differ for low point configurations to the DLT", ("other DLTs",)),
    Sentence("V-A", "an optimized configuration (red dots) limited by the circle", reason="it is about one example"),
    Sentence("V-A", "decreases drastically in the first iterations", ("early",)),
    Sentence("V-A", "mean and standard deviation ... is also reduced", ("steadier",)),
    Sentence("V-A", "slowly and smoothly converge to a stable minimum value", ("settled",)),
    Sentence("V-A", "some point configurations increase the accuracy", ("c tells", "steadier")),
    Sentence("V-A", "as well as the robustness to noise", ("steadier",)),
    Sentence("V-A", "to obtain optimized point configurations (which are better than random ones)", ("steadier",)),
    Sentence("V-A", "could improve as well the accuracy of pose estimation algorithms", ("steadier",)),
    Sentence(
        "V-A",
        "the OpenCV implementations were used",
        reason="it describes the setting; EPnP is OpenCV's here too, but for two defects",
    ),
    Sentence(
        "V-A",
        "the minimal rotation needed to align",
        reason="it is a definition, and so is TE; both are measured so here",
    ),
    Sentence(
        "V-A",
        "test if the simulation assumptions ... may affect the results in practical applications",
        reason="there is no camera here",
    ),
    Sentence(
        "V-A",
        "possible to compare the methods based on ill-conditioned (random initial points) and well-conditioned",
        reason=_DEFINITION,
    ),
    Sentence(
        "V-A",
        "Robustness (cond. num.) and accuracy (homography error) dependent on the number of points",
        ("c tells", "more points"),
    ),
    Sentence("V-A", "Two representative final point configurations", reason="they are examples"),
    Sentence("V-B", "a strong effect on the accuracy of homography and planar PnP methods", ("c tells", "steadier")),
    Sentence("V-B", "optimized configurations which are better than random", ("steadier",)),
    Sentence("V-B", "it is possible to find them using out method", ("steadier", "settled")),
    Sentence("V-B", "a square-like shape is the most common minima", ("square",)),
    Sentence("V-B", "a very stable and robust configuration for all camera poses", ("any pose", "square")),
    Sentence("V-B", "the corners of a square-like shape are common", ("holds a square",)),
    Sentence("V-B", "do not show any strong dependency with the pose of the camera", ("any pose",)),
    Sentence(
        "V-B",
        "mainly related to the distribution of the points in camera image coordinates",
        ("apart in the image", "any pose"),
    ),
    Sentence("V-B", "they are driven to distribute in space", ("apart",)),
    Sentence("V-B", "they tend to increase the distance to each other", ("apart",)),
    Sentence("V-B", "On the first iterations ... the increase in accuracy is stronger", ("early",)),
    Sentence("V-B", "the condition number is a good optimization objective", ("c tells", "c is optimal")),
    Sentence("V-B", "from a square-like configuration to a perfect square is very small", ("perfect square",)),
    Sentence("V-B", "from random points to the square-like shapes ... is radical", ("square-like",)),
    Sentence("V-B", "The smaller the number ... the more is the relative improvement", ("small n gains more",)),
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
    Sentence("V-B", "can be used for fair comparison", reason=_JUDGMENT),
    Sentence("V-B", "LM also has increased accuracy", ("steadier",)),
    Sentence(
        "V-B",
        "not directly related to the minimization of the reprojection error",
        reason="it compares definitions; how c(A) ranks LM's errors is tested above",
    ),
    Sentence("V-B", "the importance of having a good initial guess", ("initial guess",)),
    Sentence(
        "V-B",
        "The results of the real experiment closely match the simulations",
        reason="there is no camera here: the experiment's camera was simulated, with the same Gaussian noise",
    ),
    Sentence(
        "VI",
        "A method for obtaining optimized control points for homography estimation is presented",
        reason="it describes the paper",
    ),
    Sentence(
        "VI", "The lower the number ... the more the point configuration has an influence", ("small n gains more",)
    ),
    Sentence("VI", "a square is a very stable and robust configuration for all camera poses", ("any pose", "square")),
    Sentence("VI", "driven to distribute in space", ("apart",)),
    Sentence("VI", "they tend to increase the distance to each other", ("apart",)),
    Sentence("VI", "includes the optimized 4 point configuration as a subset", ("holds a square",)),
    Sentence("VI", "almost no difference in accuracy between IPPE and LM", ("IPPE equals LM",)),
    Sentence("VI", "commonly used in the optimal sensor placement research field", reason="it is about future work"),
)
"""All of them, numbered from 1."""
