"""A model of how a ROS 2 node comes by its parameters (rcl_yaml_param_parser, rclcpp's parameter_map_from).

Names of nodes are joined from nested keys; each name has one place, where it first appeared in any file; a node goes
through the places whose name matches its own, in that order, and the last value of a parameter wins.
"""

import re
from typing import Any

import yaml


def node_parameters(node: str, *files: str) -> dict[str, Any]:
    """Parameters of a node by its full name, from parameter files in the order of the command line."""
    places: dict[str, dict[str, Any]] = {}
    for text in files:
        root = yaml.compose(text, Loader=yaml.SafeLoader)
        assert isinstance(root, yaml.MappingNode)
        _read(root, "", places)
    found: dict[str, Any] = {}
    for name, values in places.items():
        if re.fullmatch(name.replace("/*", r"(/\w+)"), node):
            found |= values
    return found


def launched(node: str | None, values: dict[str, Any]) -> str:
    """The file that a launch file's dictionary becomes (launch_ros): under the node's name, if it was given one."""
    return yaml.safe_dump({node or "/**": {"ros__parameters": values}})


def _read(mapping: yaml.MappingNode, name: str, places: dict[str, dict[str, Any]]) -> None:
    for key, value in mapping.value:  # a mapping may hold a key twice, as TurtleBot3's files do
        assert isinstance(value, yaml.MappingNode)
        if key.value == "ros__parameters":
            place = places.setdefault(name, {})
            for parameter, v in _flat(value, ""):
                place[parameter] = v
        else:
            _read(value, f"{name}/{key.value.strip('/')}", places)


def _flat(mapping: yaml.MappingNode, prefix: str) -> list[tuple[str, Any]]:
    out = []
    for key, value in mapping.value:
        if isinstance(value, yaml.MappingNode):
            out += _flat(value, f"{prefix}{key.value}.")
        else:
            plain = yaml.safe_load(yaml.serialize(value))
            if isinstance(plain, list):  # rcl takes arrays of one type only
                assert len({type(item) for item in plain}) == 1, key.value
            out.append((prefix + key.value, plain))
    return out
