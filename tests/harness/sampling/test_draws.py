"""Draws as the table of an ensemble has them: each distribution, design and correlation by its definition."""

import signal
from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy import stats

import gough_stewart as gs
from tests.support.arrays import FloatArray
from tests.support.uneven import UNEVEN

N = 128
J, MOTION_BASE = UNEVEN.platform_inertia, gs.load_preset("motion_base")
PARAMETERS = {
    name: np.asarray(getattr(UNEVEN, name)).tolist()
    for name in ("platform_mass", "platform_com", "platform_inertia", "leg_lower_mass", "leg_armature", "gravity")
}


def table_of(ensemble: dict[str, Any], **settings: Any) -> dict[str, Any]:
    """The columns of what varies, in a run of four steps."""
    quick = {"loop.duration": 4e-3, "plant.parameters": PARAMETERS, "limits.reference": "warn", **settings}
    found = gs.ensemble("heave_step", {**quick, "ensemble": {"worst": 0, "seed": 8, **ensemble}}, workers=1)
    names = [name for name in found.members.columns if name.startswith("varied.")]
    return {name.removeprefix("varied."): found.members[name].to_numpy() for name in names}


def vector(columns: dict[str, Any], name: str) -> FloatArray:
    """The elements of a vector or matrix in order (n, size)."""
    return np.column_stack([values for key, values in columns.items() if key.startswith(f"{name}[")])


# How each varies, and the distribution of each of its elements.
DISTRIBUTIONS: dict[str, tuple[dict[str, Any], list[Any]]] = {
    "platform_mass": ({"normal": ["12 kg", "900 g"]}, [stats.norm(12, 0.9)]),
    "leg_lower_mass": ({"lognormal": ["2 kg", 0.2]}, [stats.lognorm(0.2, scale=2)]),
    "leg_upper_mass": ({"lognormal": 0.3}, [stats.lognorm(0.3, scale=MOTION_BASE.leg_upper_mass)]),
    "leg_armature": ({"truncated_normal": [2, 1.5, 0.5, 2.5]}, [stats.truncnorm(-1, 1 / 3, 2, 1.5)]),
    "leg_lower_com": ({"normal": 0.02}, [stats.norm(MOTION_BASE.leg_lower_com, 0.02)]),
    "leg_upper_com": ({"uniform": 0.03}, [stats.uniform(MOTION_BASE.leg_upper_com - 0.03, 0.06)]),
    "leg_lower_inertia": ({"factor": {"lognormal": 0.1}}, [stats.lognorm(0.1, scale=MOTION_BASE.leg_lower_inertia)]),
    # far up the tail of the normal distribution
    "leg_coulomb_friction": ({"truncated_normal": [0, 1, 9, 12]}, [stats.truncnorm(9, 12, 0, 1)]),
    "leg_viscous_friction": ({"uniform": [5, "11 N.s/m"]}, [stats.uniform(5, 6)]),
    "platform_com": ({"normal": [["10 mm", "20 mm", "-30 mm"], ["1 mm", "2 mm", "3 mm"]]},
                     [stats.norm(0.01 * k, 1e-3 * abs(k)) for k in (1, 2, -3)]),
    "gravity": ({"truncated_normal": [[0.1, 0.2, 0.4], 0.3]}, [
        stats.truncnorm(-0.3 / s, 0.3 / s, g, s) for g, s in zip(UNEVEN.gravity, (0.1, 0.2, 0.4), strict=True)]),
    "platform.platform_com": ({"uniform": [[0, 0.1, 0.2], ["1 cm", "12 cm", "23 cm"]]},
                              [stats.uniform(a, b) for a, b in ((0, 0.01), (0.1, 0.02), (0.2, 0.03))]),
    "disturbance.1.force": ({"offset": {"normal": [["1 N", 2, 3], [4, 5, "0.006 kN"]]}},
                            [stats.norm(11, 4), stats.norm(22, 5), stats.norm(33, 6)]),
    "platform.platform_mass": ({"offset": {"uniform": 2}}, [stats.uniform(MOTION_BASE.platform_mass - 2, 4)]),
    "sensors.noise.leg_length": ({"factor": {"truncated_normal": [1, 0.5, 0.4, 3]}},
                                 [stats.truncnorm(-1.2, 4, 2e-6, 1e-6)]),
}  # fmt: skip
OTHERS = {"disturbance": [{"at": 0, "duration": 1e-3, "force": [10, 20, 30]}], "sensors.noise": {"leg_length": 2e-6}}


@pytest.fixture(scope="module", params=["latin_hypercube", "sobol"])
def layered(request: pytest.FixtureRequest) -> dict[str, Any]:
    """Draws of which each element has one in each of N layers of equal probability."""
    ensemble = {key: how for key, (how, _) in DISTRIBUTIONS.items()}
    return table_of({"members": N, "sampling": request.param, **ensemble}, **OTHERS)


@pytest.mark.parametrize("key", DISTRIBUTIONS)
def test_every_element_has_one_draw_in_each_layer_of_its_distribution(key: str, layered: dict[str, Any]) -> None:
    """Expected: SciPy's distributions; a Latin hypercube, and 2⁷ points of Sobol', have one in each of 128 layers."""
    expected = DISTRIBUTIONS[key][1]
    values = layered[key][:, None] if len(expected) == 1 else vector(layered, key)
    assert values.shape == (N, len(expected))
    for column, distribution in zip(values.T, expected, strict=True):
        layers = np.sort(np.floor(N * distribution.cdf(column) + 1e-9))
        assert (layers == np.arange(N)).all()
    # elements are drawn for themselves
    if len(expected) > 1:
        off = np.corrcoef(values.T) - np.eye(len(expected))
        assert np.abs(off).max() < 5 / np.sqrt(N)


def test_a_symmetric_matrix_varies_as_one() -> None:
    """Expected: a factor for all elements; else six numbers, each with its own deviation about its own element."""
    deviations = [[0.1, 0.02, 0.03], [0.02, 0.2, 0.04], [0.03, 0.04, 0.3]]
    ensemble = {"members": N, "sampling": "latin_hypercube", "platform_inertia": {"normal": [J.tolist(), deviations]}}
    values = vector(table_of(ensemble), "platform_inertia").reshape(N, 3, 3)
    assert (values == np.swapaxes(values, 1, 2)).all()
    upper = np.triu_indices(3)
    u = stats.norm.cdf((values - J) / deviations)[:, *upper]
    assert (np.sort(np.floor(N * u + 1e-9), axis=0) == np.arange(N)[:, None]).all()
    assert np.abs(np.corrcoef(u.T) - np.eye(6)).max() < 5 / np.sqrt(N)
    factor = {"members": N, "sampling": "latin_hypercube", "platform_inertia": {"factor": {"uniform": [0.5, 1.5]}}}
    layers = np.floor(N * (table_of(factor)["platform_inertia.factor"] - 0.5))
    assert (np.sort(layers) == np.arange(N)).all()


CORRELATION = np.array([[1, 0.7, -0.3, 0.2], [0.7, 1, 0.1, 0.4], [-0.3, 0.1, 1, -0.5], [0.2, 0.4, -0.5, 1]])
COVARIANCE = np.array([[4.0, 1.2, 1e-8], [1.2, 1.0, 2e-8], [1e-8, 2e-8, 0.25e-14]])


@pytest.mark.parametrize(("sampling", "within"), [("random", 4.5), ("sobol", 1.5), ("latin_hypercube", 1.0)])
def test_normal_scores_have_the_correlation_of_the_matrix_in_its_order(sampling: str, within: float) -> None:
    """Expected: of 500 draws each of 21 pairs, within 4.5 standard errors (1 − ρ²)/√n; 1 of 7000 seeds fails."""
    ensemble = {
        "members": 500,
        "sampling": sampling,
        "leg_armature": {"uniform": [1, 2]},
        "platform_com": {"normal": ["1 mm", "2 mm"]},
        "correlation": [{"of": ["platform_com", "leg_armature"], "matrix": CORRELATION.tolist()}],
        "covariance": [{"of": ["leg_lower_mass", "platform_mass", "leg_upper_mass"], "matrix": COVARIANCE.tolist()}],
    }
    drawn = table_of(ensemble)
    com = (vector(drawn, "platform_com") - 1e-3) / 2e-3
    scores = np.column_stack([com, stats.norm.ppf(drawn["leg_armature"] - 1)])
    masses = np.column_stack([drawn[name] for name in ("leg_lower_mass", "platform_mass", "leg_upper_mass")])
    middle = [UNEVEN.leg_lower_mass, UNEVEN.platform_mass, MOTION_BASE.leg_upper_mass]
    deviations = np.sqrt(np.diag(COVARIANCE))
    z = np.column_stack([scores, (masses - middle) / deviations])
    R = np.eye(7)
    R[:4, :4], R[4:, 4:] = CORRELATION, COVARIANCE / np.outer(deviations, deviations)
    gap = np.abs(np.corrcoef(z.T) - R) * np.sqrt(500) / (1 - R**2 + np.eye(7))
    assert gap.max() < 4.5
    assert max(gap[:4, :4].max(), gap[4:, 4:].max()) < within
    if sampling == "latin_hypercube":
        layers = np.sort(np.floor(500 * stats.norm.cdf(z) + 1e-9), axis=0)
        assert (layers == np.arange(500)[:, None]).all()
    # 7 means and variances, each two-sided with a false alarm of 1 in 10⁵
    assert np.abs(z.mean(axis=0)).max() < 4.5 / np.sqrt(500)
    low, high = (float(stats.chi2.ppf(p, 499)) / 499 for p in (5e-6, 1 - 5e-6))
    assert ((low < z.var(axis=0)) & (z.var(axis=0) < high)).all()


def test_grids_and_choices_give_their_values_and_go_through_all_combinations() -> None:
    """Expected: counted with the last place fastest, whatever is random beside it; each value of a choice as often."""
    ensemble = {
        "members": 120,
        "platform_mass": {"grid": ["10 kg", 12, "0.015 t"]},
        "controller": {"damping_ratio": {"choice": [0.6, 0.7, 1.1]}, "feedforward": {"grid": ["gravity", "none"]}},
        "loop": {"delay": {"choice": [0, 2]}},
        "leg_armature": {"factor": {"grid": [0.5, 1, 2, 4]}},
        "gravity": {"choice": [[0, 0, -9.81], ["1 m/s2", 2, -9]]},
    }
    drawn = table_of(ensemble)
    names = ("controller.feedforward", "leg_armature", "platform_mass")
    found = list(zip(*(drawn[name].tolist() for name in names), strict=True))
    expected = product(("gravity", "none"), [0.5 * 1.7, 1.7, 2 * 1.7, 4 * 1.7], [10.0, 12.0, 15.0])
    assert [(a, pytest.approx(b), pytest.approx(c)) for a, b, c in expected] * 5 == found
    # of 120 each value of three, two-sided at 4.5 standard deviations: 1 in 10⁵
    for name, values in (("controller.damping_ratio", (0.6, 0.7, 1.1)), ("loop.delay", (0, 2))):
        share = 1 / len(values)
        counts = [int((drawn[name] == value).sum()) for value in values]
        assert sum(counts) == 120
        assert max(abs(count / 120 - share) for count in counts) < 4.5 * np.sqrt(share * (1 - share) / 120)
    rows = {tuple(row) for row in vector(drawn, "gravity").tolist()}
    assert rows == {(0, 0, -9.81), (1, 2, -9)}


def test_a_draw_far_up_the_tail_grows_with_its_score() -> None:
    """Expected: of two inputs with a correlation of 0.99 the larger of one is the larger of the other, by ranks."""
    pair = {"of": ["leg_coulomb_friction", "platform_mass"], "matrix": [[1, 0.99], [0.99, 1]]}
    far = {"leg_coulomb_friction": {"truncated_normal": [0, 1, 9, 12]}, "platform_mass": {"uniform": [10, 11]}}
    drawn = table_of({"members": 60, **far, "correlation": [pair]})
    assert stats.spearmanr(drawn["leg_coulomb_friction"], drawn["platform_mass"]).statistic > 0.9


@pytest.mark.parametrize("members", [2, 3, 4, 20])
def test_few_members_of_a_hypercube_keep_their_layers_when_they_are_correlated(members: int) -> None:
    """Expected: one member in each layer of either input; by ranks nearly the same order, if there are enough."""
    pair = {"of": ["leg_armature", "platform_mass"], "matrix": [[1, 0.999], [0.999, 1]]}
    inputs = {"leg_armature": {"uniform": [1, 2]}, "platform_mass": {"uniform": [10, 11]}}
    drawn = table_of({"members": members, "sampling": "latin_hypercube", **inputs, "correlation": [pair]})
    columns = drawn["leg_armature"] - 1, drawn["platform_mass"] - 10
    for values in columns:
        assert (np.sort(np.floor(members * values + 1e-9)) == np.arange(members)).all()
    assert members < 4 or stats.spearmanr(*columns).statistic > 0.9


def test_ctrl_c_while_sobol_reads_its_table_is_not_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    """Expected: the interrupt, when SciPy has its engine; inside it would be lost, and all points the same."""
    made = list[str]()

    class Sobol(stats.qmc.Sobol):
        def __init__(self, *arguments: Any, **options: Any) -> None:
            signal.raise_signal(signal.SIGINT)
            super().__init__(*arguments, **options)
            made.append("engine")

    monkeypatch.setattr(stats.qmc, "Sobol", Sobol)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    ensemble = {"members": 4, "sampling": "sobol", "platform_mass": {"factor": {"uniform": [0.9, 1.1]}}}
    try:
        with pytest.raises(KeyboardInterrupt):
            gs.run("heave_step", {"loop.duration": 4e-3, "ensemble": ensemble}, member=1)
    finally:
        signal.signal(signal.SIGINT, before)
    assert made == ["engine"]


def test_saltellis_design_changes_one_input_after_the_other() -> None:
    """Expected: of five rows A, A with one input from B each, and B; 2⁴ points of A and of B fill the 16 layers."""
    inputs = {"platform_mass": {"uniform": [10, 11]}, "platform_com": {"uniform": [0, 1]}}
    ensemble = {"members": 80, "sampling": "saltelli", **inputs, "leg_armature": {"uniform": [1, 2]}}
    drawn = table_of(ensemble)
    points = np.column_stack([drawn["leg_armature"] - 1, vector(drawn, "platform_com"), drawn["platform_mass"] - 10])
    blocks = points.reshape(16, 5, 5)
    first, last = blocks[:, 0], blocks[:, 4]
    assert not np.isclose(first, last).any()
    for k, group in enumerate((slice(0, 1), slice(1, 4), slice(4, 5))):
        mixed = first.copy()
        mixed[:, group] = last[:, group]
        assert np.allclose(blocks[:, 1 + k], mixed, atol=1e-12)
    for part in (first, last):
        assert (np.sort(np.floor(16 * part), axis=0) == np.arange(16)[:, None]).all()
    # a member alone is the same
    quick = {"loop.duration": 4e-3, "plant.parameters": PARAMETERS, "limits.reference": "warn"}
    alone = gs.run("heave_step", {**quick, "ensemble": {"worst": 0, "seed": 8, **ensemble}}, member=8)
    assert alone.metadata["machine"]["platform_mass"] == drawn["platform_mass"][8]


def test_random_draws_depend_on_seed_name_and_number_alone() -> None:
    """Expected: the same for fewer members and beside another input; others for another seed; uniform."""
    # by Kolmogorov and Smirnov, false alarm of 1 in 2000 a column; correlations below 4.4 standard errors, 1 in 10⁵
    alone = {"platform_mass": {"uniform": [10, 11]}, "platform_com": {"uniform": [0, 1]}}
    many = table_of({"members": 400, **alone})
    beside = table_of({"members": 90, "leg_armature": {"uniform": [1, 2]}, **alone})
    for name in ("platform_mass", "platform_com[1]", "platform_com[3]"):
        assert (beside[name] == many[name][:90]).all()
    other = table_of({"members": 90, **alone, "seed": 9})
    assert not np.isclose(other["platform_mass"], many["platform_mass"][:90]).any()
    u = np.column_stack([many["platform_mass"] - 10, vector(many, "platform_com")])
    assert all(stats.kstest(column, "uniform").pvalue > 0.0005 for column in u.T)
    assert np.abs(np.corrcoef(u.T) - np.eye(4)).max() < 4.4 / np.sqrt(400)
    assert np.abs(np.corrcoef(u[1:, 0], u[:-1, 0])[0, 1]) < 4.4 / np.sqrt(400)


ABOUT, DEVIATION = "about the present value", "standard deviation, bound"
# How the mass varies, and what is said of it.
OF_MASS: list[tuple[dict[str, Any], str]] = [
    ({"normal": [120, 0]}, "without a spread; expected a standard deviation > 0"),
    ({"truncated_normal": [0, 1]}, "without a spread; expected a standard deviation > 0"),
    ({"truncated_normal": [1, 0]}, "without a spread; expected a bound > 0"),
    ({"truncated_normal": [5, 1, 6, 4]}, "expected the lower bound below the upper one"),
    ({"uniform": 0}, "without a spread; expected a half width > 0"),
    ({"lognormal": [1, 0]}, "without a spread; expected a deviation of the logarithm > 0"),
    ({"lognormal": "0.2 kg"}, "expected a number"),
    ({"factor": {"uniform": ["1 kg", "2 kg"]}}, "expected a number"),
    ({"lognormal": [-3, 1]}, "has the median -3.0; expected a median > 0"),
    ({"choice": [4, "4 kg"]}, "expected at least two values that differ"),
    ({"grid": []}, "platform_mass: grid has no values"),
    ({"normal": ["120 kg", "10 mm"]}, "found the unit 'mm'"),
    ({"normal": [1, 2, 3]}, f"is [1, 2, 3]; expected [mean, standard deviation], or a standard deviation {ABOUT}"),
    ({"truncated_normal": [1, 2, 3]}, f"expected [mean, standard deviation, low, high], or [{DEVIATION}] {ABOUT}"),
    ({"offset": {"offset": {"normal": 1}}}, "offset of a offset; expected a distribution in it"),
    ({"normal": [1, 1], "grid": [1, 2]}, "lognormal, choice, grid, factor, offset; found normal and grid"),
    ({"normal": [1, 1], "gauss": [1, 1]}, "gauss: unknown key"),
]
WRONG: list[tuple[dict[str, Any], str]] = [
    *(({"platform_mass": how}, says) for how, says in OF_MASS),
    ({"platform_mas": 3}, "platform_mas: is 3; expected a setting of the ensemble (members,"),
    ({"gravity": {"normal": [[0, 0, 1], [1, 1]]}}, "is [1, 1]; expected 3 elements"),
    ({"gravity": {"choice": [9.8, 9.9]}}, "is 9.8; expected 3 elements"),
    ({"gravity": {"uniform": [[0, 0, 0], [1, 0, 1]]}}, "expected the lower bound below the upper one"),
    ({"members": 0}, "members: is 0"),
    ({"worst": 1001}, "worst: is 1001; expected less than or equal to 1000"),
    ({"sampling": "sobel"}, "sampling: is 'sobel'"),
    ({"correlation": [{"of": [], "matrix": []}]}, "of is []; expected different names"),
    ({"correlation": [{"of": ["gravity", "platform_mass"], "matrix": [[1, 0]]}]}, "the matrix has shape (1, 2)"),
    ({"controller": {"bandwidth": 3}}, "controller.bandwidth: is 3; expected a setting of the ensemble"),
    ({"correlation": [{"of": ["gravity", "gravity"], "matrix": [[1, 0], [0, 1]]}]}, "expected different names"),
    *(({"correlation": [{"of": ["a", "b", "c"][: len(matrix)], "matrix": matrix}]}, f"the matrix is not {what}")
      for matrix, what in (
          ([[1, 0.9, -0.9], [0.9, 1, 0.9], [-0.9, 0.9, 1]], "positive definite"),
          ([[1, 1], [1, 1]], "positive definite"),
          ([[-1, 0], [0, 1]], "positive definite"),
          ([[1, 0.5], [0.500001, 1]], "symmetric"),
      )),
    ({"covariance": [{"of": ["a", "b"], "matrix": [[1, 2], [2, 1]]}]}, "not positive definite (smallest eigenvalue -1"),
    ({"members": 10_000_000, "sampling": "latin_hypercube", "gravity": {"normal": 1}},
     "a Latin hypercube of 10000000 members with 3 numbers each can only be drawn as a whole; expected at most "
     "20000000 numbers; use sampling = 'sobol' or 'random'"),
]  # fmt: skip


@pytest.mark.parametrize(("table", "says"), WRONG)
def test_what_is_no_variation_says_what_is_expected(table: dict[str, Any], says: str) -> None:
    """Expected: found, expected, remedy, written out here."""
    with pytest.raises(gs.GoughStewartError) as caught:
        gs.run("heave_step", {"ensemble": table}, member=0)
    assert says in str(caught.value)


def test_a_choice_keeps_texts_switches_and_numbers_as_they_are() -> None:
    """Expected: values of their own types, also where some are numbers and some are not; lists as lists."""

    def modal(_platform: gs.Platform, _sample_time: float, **_parameters: Any) -> Any:
        return lambda _sample: np.zeros(6)

    settings = {
        "loop.duration": 4e-3,
        "controller": {"type": "python", "parameters": {"mode": "slow", "levels": [1.0, 2.0], "steps": 3}},
        "ensemble": {
            "members": 12,
            "controller": {"parameters": {
                "mode": {"choice": ["fast", 3.5, True]},
                "levels": {"choice": [[0.5, 4], [1, 2]]},
                "steps": {"choice": [2, 5]},
            }},
        },
    }  # fmt: skip
    records = [gs.run("heave_step", settings, member=member, controller=modal) for member in range(12)]
    found = [record.metadata["experiment"]["controller"]["parameters"] for record in records]
    assert {(type(each["mode"]), each["mode"]) for each in found} == {(str, "fast"), (float, 3.5), (bool, True)}
    assert {(type(each["steps"]), each["steps"]) for each in found} == {(int, 2), (int, 5)}
    assert {tuple(each["levels"]) for each in found} == {(0.5, 4), (1, 2)}
    table = gs.ensemble("heave_step", {**settings, "ensemble.worst": 0}, controller=modal, workers=1)
    assert table.members["varied.controller.parameters.mode"].to_list() == [str(each["mode"]) for each in found]


def test_only_a_hypercube_is_drawn_as_a_whole() -> None:
    """Expected: of ten million members with three numbers each the last one, which is what it is among fewer."""
    few, many, last = (
        gs.run("heave_step", {"loop.duration": 4e-3, "ensemble": {"members": n, "gravity": {"normal": 0.1}}}, member=k)
        for n, k in ((78, 77), (10_000_000, 77), (10_000_000, 9_999_999))
    )
    assert many.metadata["machine"] == few.metadata["machine"]
    assert last.metadata["machine"]["gravity"] != few.metadata["machine"]["gravity"]
