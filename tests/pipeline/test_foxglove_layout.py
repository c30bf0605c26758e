"""The Foxglove layout in docs/ names only what a recording of ours has, in words that Foxglove knows."""

import json
import re
from pathlib import Path

import foxglove.layouts as fl
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from wrenchflow.camera import View
from wrenchflow.episode import Episode
from wrenchflow.recording.images import image_messages, jpeg
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode
from wrenchflow.signals import GOVERNOR

LAYOUT = json.loads((Path(__file__).parents[2] / "docs" / "foxglove-layout.json").read_text())
CONFIGS = {
    "3D": fl.ThreeDeeConfig,
    "Image": fl.ImageConfig,
    "Plot": fl.PlotConfig,
    "RawMessages": fl.RawMessagesConfig,
    "StateTransitions": fl.StateTransitionsConfig,
}


@pytest.fixture(scope="module")
def first_messages(wrenchflow, rig, tmp_path_factory):
    """The first message of each topic, decoded by another reader, and the frame of what is drawn in space."""
    at = tmp_path_factory.mktemp("layout")
    wrenchflow("collect", at / "raw", "--episodes", 1, "--seed", 3, "--tare-s", 0.5, "--jobs", 1)
    assert wrenchflow("process", at / "raw", at / "clean", "--jobs", 1).code == 0
    episode = read_episode(next((at / "clean").glob("*.mcap")))
    picture = jpeg(np.zeros((24, 32, 3), np.uint8))
    frames = [View(name=camera.name).frame for camera in rig.cameras]
    cameras = {frame: image_messages(episode["tcp_pose"].t[:1], [picture], frame) for frame in frames}
    whole = Episode(episode.id, episode.task, episode.streams, episode.events, episode.meta, cameras)
    write_episode(at / "whole.mcap", whole)
    found = {}
    with (at / "whole.mcap").open("rb") as file:
        for _, channel, _, message in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages():
            found.setdefault(channel.topic, message)
    return found


def message_paths() -> list[str]:
    configs = LAYOUT["configById"].values()
    plotted = [path["value"] for config in configs for path in config.get("paths", [])]
    return plotted + [config["topicPath"] for config in configs if "topicPath" in config]


@pytest.mark.parametrize("path", message_paths())
def test_every_path_leads_to_a_value(first_messages, path):
    topic = max((topic for topic in first_messages if path.startswith(topic + ".")), key=len)
    value = first_messages[topic]
    for name in re.findall(r"\w+", path.removeprefix(topic)):
        value = value[int(name)] if name.isdigit() else getattr(value, name)
    assert isinstance(value, float | str)


def test_columns_of_the_safety_layer_are_those_that_the_legend_names(first_messages):
    paths = [path for config in LAYOUT["configById"].values() for path in config.get("paths", [])]
    named = {path["label"]: path["value"] for path in paths if path["value"].startswith("/governor.")}
    assert named.keys() >= {"mode", "tank", "spring", "budget"}
    for label, value in named.items():
        assert value == f"/governor.data[{GOVERNOR.columns.index(label)}]"


def test_a_message_without_a_stamp_is_plotted_at_the_time_that_it_was_had(first_messages):
    for config in LAYOUT["configById"].values():
        for path in config.get("paths", []):
            message = first_messages[max((t for t in first_messages if path["value"].startswith(t + ".")), key=len)]
            assert path["timestampMethod"] == ("headerStamp" if hasattr(message, "header") else "receiveTime")


def test_every_topic_is_recorded_in_the_frame_that_is_shown(first_messages):
    space = LAYOUT["configById"]["3D!space"]
    assert {"/tcp_pose", "/goal_pose"} <= space["topics"].keys()
    for topic in space["topics"]:
        assert first_messages[topic].header.frame_id == space["followTf"]
    images = [config["imageMode"]["imageTopic"] for config in LAYOUT["configById"].values() if "imageMode" in config]
    assert images == ["/camera/wrist", "/camera/scene"]
    assert all(first_messages[topic].format == "jpeg" for topic in images)


def test_every_setting_is_one_that_foxglove_knows():
    for name, config in LAYOUT["configById"].items():
        kind = name.partition("!")[0]
        if kind == "Tab":
            continue
        assert config.keys() - {"foxglovePanelTitle"} <= CONFIGS[kind]()._to_dict().keys(), name
        series = {"Plot": fl.PlotSeries, "StateTransitions": fl.StateTransitionsSeries}.get(kind)
        for path in config.get("paths", []):
            assert series is not None
            assert path.keys() <= series()._to_dict().keys()


def test_every_panel_has_its_place():
    def panels(layout):
        if isinstance(layout, str):
            tabs = LAYOUT["configById"][layout].get("tabs", [])
            return [layout, *(name for tab in tabs for name in panels(tab["layout"]))]
        return panels(layout["first"]) + panels(layout["second"])

    assert sorted(panels(LAYOUT["layout"])) == sorted(LAYOUT["configById"])
