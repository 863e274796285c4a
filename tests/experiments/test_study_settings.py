"""What a person may write about a study, on the command line and in a file."""

import dataclasses
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gplfd_env.doors.config import door_config
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.studies.settings import (
    PRESETS,
    StudySettings,
    read_settings,
    settings_named,
    write_settings,
)
from gplfd_experiments.studies.tasks import SkillTask, checked, tasks
from gplfd_policies.registry.built_in import TABLE_1

NAMES = st.lists(st.text(st.characters(exclude_categories=["Cs"])), max_size=3)


@given(
    st.builds(
        StudySettings,
        policies=NAMES.map(tuple),
        doors=NAMES.map(tuple),
        seeds=st.integers(-9, 2**62),
        demonstrations_per_door=st.lists(st.integers(0, 9)).map(tuple),
        teacher_noise=st.lists(st.floats(allow_nan=False, allow_infinity=False)).map(
            tuple
        ),
        randomizations=NAMES.map(tuple),
        start=st.sampled_from(["grasped", "approach"]),
        skill=st.booleans(),
    )
)
def test_settings_come_back_from_their_file(tmp_path_factory, settings):
    path = tmp_path_factory.getbasetemp() / "study.toml"
    write_settings(path, settings)
    assert read_settings(path) == settings


def test_a_file_need_not_say_everything(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text('doors = ["small", 0.42]\nteacher_noise = [2]\n')
    assert settings_named(str(path)) == StudySettings(
        doors=("small", "0.42"), teacher_noise=(2.0,)
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sedes = 3", "unknown key 'sedes' (did you mean 'seeds'?); keys: policies"),
        ("seeds = ", "cannot be read as TOML: Invalid value"),
        ("seeds = 2.5", "seeds = 2.5 must be a whole number"),
        ("doors = ['Tür']", "cannot be read as TOML: 'utf-8' codec can't decode"),
    ],
)
def test_a_wrong_file_is_refused(tmp_path, text, message):
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="latin-1")
    with pytest.raises(ValueError, match=f"{path}.*{re.escape(message)}"):
        read_settings(path)


def planned(settings):
    """All tasks of a study, its episodes, and its learning tests."""
    study = tasks(checked(settings))
    episodes, tests = (
        [task for task in study if isinstance(task, kind)]
        for kind in (EpisodeTask, SkillTask)
    )
    return study, episodes, tests


def test_the_whole_comparison_is_table_1_on_known_and_new_doors():
    study, opened, tested = planned(PRESETS["table-1"])
    learners = {*TABLE_1, "mean"}
    assert len(opened) == (len(learners) + 1) * 7 * 20
    assert len(tested) == len(learners) * 2 * 20
    assert len({task.key for task in study}) == len(study)
    assert {task.policy for task in tested} == learners
    assert {task.policy for task in opened} == {*learners, "hinge-fit"}
    assert sorted({door_config(dict(task.door_config)).radius for task in opened}) == [
        *(0.30, 0.35, 0.42, 0.50, 0.58, 0.62, 0.65)
    ]


def test_everything_is_crossed_with_everything():
    settings = StudySettings(
        policies=("gp", "oracle"),
        doors=("small", "0.42"),
        seeds=2,
        demonstrations_per_door=(1, 2),
        teacher_noise=(1.0, 3.0),
        randomizations=("none", "mild", "hard"),
    )
    study, opened, tested = planned(settings)
    assert len(opened) == len({task.key for task in opened}) == 2 * 2 * 2 * 2 * 2 * 3
    # The oracle learns nothing, and doors at random matter to robots only.
    assert {task.policy for task in tested} == {"gp"}
    assert len(tested) == len({task.key for task in tested}) == 2 * 2 * 2 * 2
    assert [task.seed for task in study] == sorted(task.seed for task in study)
    assert planned(dataclasses.replace(settings, skill=False))[2] == []
