"""PSO-SAVL by its equations, and one contract that every optimiser keeps."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np
import pytest

from models.pso import (
    OPTIMISERS,
    PSO_SAVL,
    PSO_SAVL_PRINTED,
    PSO_SAVL_SHARED,
    ParticleSwarm,
    _take_over,
    evolutionary_state,
    printed_limit,
    savl_limit,
)


@dataclass
class Bowls:
    """One bowl per problem, its bottom at ``centre``, allowed where D1 >= ``wall``."""

    centre: np.ndarray
    wall: float = 0.0
    calls: list[np.ndarray] = field(default_factory=list)
    best: dict[bytes, float] = field(default_factory=dict)

    @property
    def count(self) -> int:
        return len(self.centre)

    def allowed(self, x):
        return x[..., 0] >= self.wall

    def value(self, x):
        self.calls.append(x)
        value = np.where(self.allowed(x), 1 - ((x - self.centre[:, None]) ** 2).sum(axis=-1), -np.inf)
        for centre, top in zip(self.centre, value.max(axis=1), strict=True):
            self.best[centre.tobytes()] = max(self.best.get(centre.tobytes(), -np.inf), top)
        return value

    def one(self, number) -> Self:
        return type(self)(centre=self.centre[[number]], wall=self.wall, calls=self.calls, best=self.best)


CENTRES = np.array([[0.2, 0.7], [0.5, 0.5], [0.93, 0.04]])
each_optimiser = pytest.mark.parametrize("optimiser", OPTIMISERS, ids=lambda o: o.name)


@each_optimiser
def test_finds_the_bottom_of_each_bowl(optimiser):
    found = optimiser.maximise(Bowls(CENTRES), seed=1)
    # 500 evaluations: a lattice of as many points has a spacing of 0.045; the search must do better
    np.testing.assert_allclose(found.x, CENTRES, atol=0.02)


@each_optimiser
def test_value_is_the_value_at_x(optimiser):
    problem = Bowls(CENTRES)
    found = optimiser.maximise(problem, seed=2)
    np.testing.assert_array_equal(found.value, problem.value(found.x[:, None, :])[:, 0])


@each_optimiser
def test_answers_with_the_best_point_it_met(optimiser):
    problem = Bowls(CENTRES, wall=0.3)
    found = optimiser.maximise(problem, seed=8)
    assert found.value.tolist() == [problem.best[centre.tobytes()] for centre in CENTRES]


@each_optimiser
def test_never_leaves_the_box_or_answers_outside_the_mask(optimiser):
    problem = Bowls(CENTRES, wall=0.6)
    found = optimiser.maximise(problem, seed=3)
    assert all(((x >= 0) & (x <= 1)).all() for x in problem.calls)
    assert problem.allowed(found.x).all()


@each_optimiser
def test_same_seed_same_answer_and_other_seed_other_answer(optimiser):
    one, two, other = (optimiser.maximise(Bowls(CENTRES), seed=s) for s in (4, 4, 5))
    np.testing.assert_array_equal(one.x, two.x)
    assert (one.x != other.x).any()


@each_optimiser
def test_says_when_nothing_is_allowed(optimiser):
    assert (optimiser.maximise(Bowls(CENTRES, wall=2.0), seed=6).value == -np.inf).all()


@each_optimiser
def test_counts_its_evaluations(optimiser):
    problem = Bowls(CENTRES)
    found = optimiser.maximise(problem, seed=7)
    assert sum(x.shape[0] * x.shape[1] for x in problem.calls) == found.evaluations * problem.count


def test_table_4_budget():
    assert (PSO_SAVL.particles, PSO_SAVL.iterations, PSO_SAVL.learning) == (10, 50, 2.05)
    assert PSO_SAVL.inertia == (0.9, 0.1)
    problem = Bowls(CENTRES)
    PSO_SAVL.maximise(problem, seed=0)
    assert [x.shape for x in problem.calls] == [(3, 10, 2)] * 50  # one call per iteration for all loads


def test_velocity_limit_runs_between_its_ends():
    f = np.linspace(0, 1, 11)
    assert savl_limit(f)[[0, -1]] == pytest.approx([0.05, 0.2], abs=1e-12)
    assert (np.diff(savl_limit(f)) > 0).all()
    # as printed: 1 / (1 + 4) and 1 / (1 + 4 · 4/19)
    assert printed_limit(f)[[0, -1]] == pytest.approx([0.2, 19 / 35], abs=1e-12)


def test_state_is_zero_when_the_best_is_in_the_middle_and_one_when_it_is_outermost():
    line = np.array([[[0.0, 0.0], [0.5, 0.0], [0.6, 0.0], [1.0, 0.0]]])  # sums of distances 2.1 1.1 1.1 1.9
    assert evolutionary_state(line, np.array([1])) == pytest.approx([0.0])
    assert evolutionary_state(line, np.array([0])) == pytest.approx([1.0])
    assert evolutionary_state(line, np.array([3])) == pytest.approx([0.8])


def test_state_is_zero_when_all_distances_are_equal():
    assert evolutionary_state(np.full((1, 5, 2), 0.3), np.array([2])) == [0.0]
    triangle = np.array([[[0.0, 0.0], [1.0, 0.0], [0.5, np.sqrt(0.75)]]])
    assert evolutionary_state(triangle, np.array([1])) == [0.0]


def test_a_velocity_beyond_its_limit_is_clamped_near_the_end_and_redrawn_while_exploring():
    rng = np.random.default_rng(0)
    v = np.tile([0.9, 0.01], (2, 200, 1))
    out = PSO_SAVL._limited(v, np.array([0.0, 1.0]), rng)
    assert (np.abs(out[0, :, 0]) <= 0.05 + 1e-12).all()
    assert np.ptp(out[0, :, 0]) > 0.08  # uniform over 0.1: 200 draws leave less with odds of 1e-17
    np.testing.assert_allclose(out[1, :, 0], 0.2)
    np.testing.assert_array_equal(out[..., 1], 0.01)


def test_the_printed_equation_gives_another_search():
    one, two = (o.maximise(Bowls(CENTRES), seed=1).x for o in (PSO_SAVL, PSO_SAVL_PRINTED))
    assert (one != two).any()


def test_the_swarm_starts_on_allowed_points():
    problem = Bowls(CENTRES, wall=0.8)
    ParticleSwarm(name="one step", limit=savl_limit, redraw=True, iterations=1).maximise(problem, seed=1)
    assert problem.allowed(problem.calls[0]).all()


def test_a_leader_is_taken_over_by_the_loads_beside_it():
    x, leader = np.zeros((3, 4, 2)), np.array([[0.1, 0.1], [0.5, 0.5], [0.9, 0.9]])
    value = np.array([[3.0, 1.0, 2.0, 4.0]] * 3)
    _take_over(x, value, leader)
    assert x[1, [1, 2], 0].tolist() == [0.1, 0.9]  # the two worst of the middle swarm
    assert x[0, [1, 2], 0].tolist() == [0.1, 0.5]  # the first one has one neighbour, and itself
    assert (x[:, [0, 3]] == 0).all()


def test_sharing_costs_no_evaluation():
    problem = Bowls(CENTRES)
    PSO_SAVL_SHARED.maximise(problem, seed=0)
    assert [x.shape for x in problem.calls] == [(3, 10, 2)] * 50
