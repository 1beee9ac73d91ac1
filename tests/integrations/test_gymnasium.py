"""Environments for Gymnasium: its own checks, spaces, seeds, time limit, and many at once."""

from __future__ import annotations

import pickle
import sys
import warnings
from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.errors import InputError
from objects import refused

gymnasium = pytest.importorskip(
    "gymnasium", reason="needs the extra gymnasium", exc_type=ImportError
)

from gymnasium.utils.env_checker import check_env  # noqa: E402

from bowstring.gymnasium import REACH, MotionSettings, ReachEnv, ReachVectorEnv  # noqa: E402


@pytest.mark.parametrize("dtype", ["float32", "float64"])
@pytest.mark.parametrize("name", ["amouri2019", "rao2021"])
def test_the_environment_passes_the_checks_of_gymnasium(name: str, dtype: str) -> None:
    with warnings.catch_warnings():
        # velocities have no bound
        warnings.filterwarnings("ignore", message=".*(infinity|inf).*")
        check_env(ReachEnv(name, dtype=dtype), skip_render_check=True)


def test_it_is_registered() -> None:
    env = gymnasium.make(REACH, max_tension=40.0)
    observation, info = env.reset(seed=3)
    assert observation in env.observation_space and set(info) >= {"distance_m", "status"}
    envs = gymnasium.make_vec(REACH, num_envs=4, max_tension=40.0)
    observations, _ = envs.reset(seed=3)
    assert isinstance(envs.unwrapped, ReachVectorEnv)
    assert np.array_equal(observations[0], observation)
    env.close()
    envs.close()


def test_an_observation_holds_what_it_says() -> None:
    env = ReachEnv("amouri2019", max_tension=40, dtype="float64")
    env.reset(seed=5)
    action = np.array([30.0, 10, 0])
    observation, reward, terminated, truncated, info = env.step(action)
    state = env.motions.state
    parts = np.split(observation, np.cumsum([3, 9, 3, 3, 3, 3]))
    expected = (
        state.tip_position,
        state.tip_rotation,
        state.tip_velocity,
        state.tip_angular_velocity,
        state.tendon_lengths,
        action,
    )
    for part, value in zip(parts[:6], expected, strict=True):
        assert np.array_equal(part, np.ravel(value))
    distance = np.linalg.norm(state.tip_position[0] - parts[6])
    assert reward == pytest.approx(-distance / 0.641) and not terminated and not truncated
    assert info["distance_m"] == pytest.approx(distance)
    assert info["is_success"] is bool(distance <= 0.00641)


def test_a_target_is_reached_in_its_equilibrium() -> None:
    """The target is a tip of statics: damped and under its tensions the robot comes there."""
    motion = MotionSettings(integrator=bs.Integrator(mass_damping=20.0))
    env = ReachEnv("amouri2019", max_tension=40, motion=motion)
    _, info = env.reset(seed=11)
    twin = np.random.default_rng(0)
    twin.bit_generator.state = gymnasium.utils.seeding.np_random(11)[0].bit_generator.state
    twin.uniform(0, 40, 3)  # of the start
    action = twin.uniform(0, 40, 3).astype(np.float32)
    for _ in range(100):
        *_, info = env.step(action)
    assert info["is_success"] and info["distance_m"] < 1e-3


def test_the_time_limit_truncates() -> None:
    env = ReachEnv("amouri2019", max_episode_steps=3)
    refused("call reset first", lambda: env.step(env.action_space.sample()))
    env.reset(seed=0)
    ends = [env.step(np.zeros(3) + 10)[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]
    refused("call reset first", lambda: env.step(np.zeros(3)))


def test_many_environments_are_as_single_ones() -> None:
    settings: dict[str, Any] = {"max_tension": 40.0, "max_episode_steps": 5}
    count = 5
    envs = ReachVectorEnv(count, "amouri2019", **settings)
    singles = [ReachEnv("amouri2019", **settings) for _ in range(count)]
    found, _ = envs.reset(seed=20)
    alone = [env.reset(seed=20 + i)[0] for i, env in enumerate(singles)]
    np.testing.assert_allclose(found, alone, rtol=1e-6, atol=1e-6)
    random = np.random.default_rng(0)
    ended = [False] * count
    for _ in range(14):
        actions = random.uniform(0, 40, (count, 3)).astype(np.float32)
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        assert observations in envs.observation_space
        for i, env in enumerate(singles):
            if ended[i]:  # by the convention of Gymnasium the action is ignored
                observation, info = env.reset()
                step = (observation, 0.0, False, False, info)
            else:
                step = env.step(actions[i])
            np.testing.assert_allclose(observations[i], step[0], rtol=1e-5, atol=1e-5)
            assert rewards[i] == pytest.approx(step[1], rel=1e-6, abs=1e-9)
            assert (terminated[i], truncated[i]) == step[2:4]
            assert infos["distance_m"][i] == pytest.approx(step[4]["distance_m"])
            ended[i] = step[2] or step[3]
    again, _ = envs.reset(seed=20)
    assert np.array_equal(again, found)


def test_a_motion_that_fails_terminates() -> None:
    env = ReachEnv("amouri2019", max_tension=1e7, dtype="float64")
    env.motions.reset(tensions=[10, 10, 10])
    env._ended = False
    observation, _, terminated, truncated, info = env.step(np.array([1e7, 0, 0]))
    assert terminated and not truncated and np.isfinite(observation).all()
    assert info["status"] in ("step_failed", "collision")


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"max_tension": -1.0}, "max_tension is -1 N"),
        ({"dtype": "int8"}, "dtype is 'int8'"),
        ({"motion": 0.01}, "motion is 0.01, it must be a MotionSettings"),
        ({"render_mode": "human"}, "render_mode is 'human'"),
        ({"max_episode_steps": 0}, "max_episode_steps is 0"),
        ({"robot": "nobody"}, "nobody"),
        ({"max_tension": 1e9}, "give a smaller max_tension"),
    ],
)
def test_wrong_arguments(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError) as error:
        ReachEnv(**settings).reset(seed=0)
    assert said in str(error.value)


@pytest.mark.parametrize("action", [[1.0, 2.0], [np.nan, 0, 0], "pull", [[1.0, 2, 3]]])
def test_wrong_actions(action: Any) -> None:
    env = ReachEnv("amouri2019")
    env.reset(seed=0)
    refused("action", lambda: env.step(action))


def test_without_gymnasium(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    for name in ("bowstring.gymnasium", "bowstring.integrations.gymnasium"):
        monkeypatch.delitem(sys.modules, name)
    refused(r"pip install 'bowstring\[gymnasium\]'", lambda: __import__("bowstring.gymnasium"))


def test_a_copy_by_pickle_has_the_same_robot_and_settings() -> None:
    for env in (ReachEnv(max_tension=40, dtype="float64"), ReachVectorEnv(1, max_tension=40)):
        again = pickle.loads(pickle.dumps(env))
        observation, other = (each.reset(seed=3)[0] for each in (env, again))
        assert np.array_equal(observation, other) and observation.dtype == other.dtype
