"""Nominal wheels from YAML, JSON and URDF, and one clear line for every other file."""

import re
from pathlib import Path

import pytest

from boxcal.calib.errors import CalibError
from boxcal.calib.exports.nominal import MAX_YAML_BYTES, load_nominal

URDF = """<?xml version="1.0"?>
<robot name="r">
  <link name="base"/><link name="axle"/>
  <link name="wl"><visual><geometry><cylinder radius="0.033" length="0.02"/></geometry></visual></link>
  <link name="wr"><collision><geometry><sphere radius="0.033"/></geometry></collision></link>
  <joint name="axle_joint" type="fixed"><parent link="base"/><child link="axle"/>
    <origin xyz="-0.1 0 0.02" rpy="0 0 0.3"/></joint>
  <joint name="wheel_left_joint" type="continuous"><parent link="axle"/><child link="wl"/>
    <origin xyz="0.01 0.08 0" rpy="-1.5707963267948966 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="wheel_right_joint" type="continuous"><parent link="axle"/><child link="wr"/>
    <origin xyz="0 -0.08 0" rpy="-1.5707963267948966 0 0"/><axis xyz="0 0 1"/></joint>
  <joint name="caster_joint" type="continuous"><parent link="base"/><child link="caster"/></joint>
</robot>
"""


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("n.yaml", "wheel_radius: 0.033\nwheel_separation: 0.16\n"),
        ("n.json", '{"wheel_separation": 0.16, "wheel_radius": 0.033}'),
        (
            "n.yml",
            "/**:\n  ros__parameters:\n    wheel_radius: 3.3e-2\n    wheel_separation: 0.16\n    other: [1, {a: b}]\n",
        ),
        ("turtlebot3.yaml", "turtlebot3_node:\n  ros__parameters:\n    wheels: {separation: 0.160, radius: 0.033}\n"),
        ("raspimouse.yaml", "raspimouse:\n  ros__parameters: {wheel_diameter: 0.066, wheel_tread: 0.16}\n"),
        ("n.urdf", URDF),
    ],
)
def test_nominal_wheels_are_read_from_yaml_json_and_urdf(tmp_path: Path, name: str, text: str) -> None:
    (tmp_path / name).write_text(text)
    nominal = load_nominal(tmp_path / name)
    assert nominal.wheel_radius == 0.033
    assert nominal.wheel_separation == pytest.approx(0.16, abs=1e-12)
    assert nominal.source == name


def test_odometry_is_reckoned_with_a_drivers_multipliers(tmp_path: Path) -> None:
    """Multipliers that are written are against the plain values; the driver's odometry has them in it."""
    text = "wheel_radius: 0.033\nwheel_separation: 0.16\nwheel_separation_multiplier: 1.1\n"
    sides = "left_wheel_radius_multiplier: {0}\nright_wheel_radius_multiplier: {1}\n"
    (tmp_path / "alike.yaml").write_text(text + sides.format(1.02, 1.02))
    nominal = load_nominal(tmp_path / "alike.yaml")
    assert (nominal.wheel_radius, nominal.wheel_separation) == (0.033, 0.16)
    assert nominal.driver == pytest.approx((0.033 * 1.02, 0.16 * 1.1))
    (tmp_path / "unlike.yaml").write_text(text + sides.format(1.02, 1.01))
    assert load_nominal(tmp_path / "unlike.yaml").driver is None


BOMB = "a: &a [1,1]\n" + "".join(
    f"{b}: &{b} [{','.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefghi", "bcdefghij", strict=True)
)
MERGE = "a: &a {x: 1}\n" + "".join(
    f"{b}: &{b}\n  <<: [{','.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
DOCTYPE = '<!DOCTYPE r [<!ENTITY a "{0}">]><robot name="&a;"/>'


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("n.yaml", "wheel_radius: 0.033\n", "no wheel_radius with a wheel_separation"),
        (
            "n.yaml",
            "a: {wheel_radius: 1, wheel_separation: 1}\nb: {wheel_radius: 1, wheel_separation: 2}",
            "2 different",
        ),
        ("n.yaml", "wheel_radius: .inf\nwheel_separation: 1.0", "positive number of metres"),
        ("n.yaml", "wheel_radius: true\nwheel_separation: 1.0", "is no number"),
        ("n.yaml", f"wheel_radius: {'9' * 400}\nwheel_separation: 1.0", "1e308"),
        ("n.yaml", "[" * 50_000, "nested deeply"),
        ("n.yaml", "!!python/object/apply:os.system ['true']", "not YAML"),
        ("n.yaml", "a: b: c", "not YAML"),
        ("n.yaml", BOMB, "aliases"),
        ("n.yaml", MERGE, "aliases"),
        ("n.yaml", "#" * (MAX_YAML_BYTES + 1), "at most"),
        ("n.urdf", DOCTYPE, "document type"),
        ("n.urdf", URDF[:300], "not a whole URDF"),
        ("n.urdf", "<sdf/>", "robot is needed"),
        (
            "n.urdf.xacro",
            '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="w"/></robot>',
            "expand it with xacro first",
        ),
        ("n.urdf", '<robot name="r"/>', "0 left wheel joints"),
        ("n.urdf", URDF.replace('<cylinder radius="0.033" length="0.02"/>', '<mesh filename="w.stl"/>'), "no cylinder"),
        ("n.urdf", URDF.replace('sphere radius="0.033"', 'sphere radius="0.034"'), "one nominal radius"),
        ("n.urdf", URDF.replace('sphere radius="0.033"', 'sphere radius="${r}"'), "expand it with xacro"),
        ("n.urdf", URDF.replace('<child link="axle"/>', '<child link="base"/>').replace("axle", "base"), "ring"),
    ],
)
def test_a_file_without_nominal_wheels_gets_one_clear_line(tmp_path: Path, name: str, text: str, says: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(CalibError, match=f"^{re.escape(name)}: .*{re.escape(says)}") as caught:
        load_nominal(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_a_missing_nominal_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(CalibError, match=r"n\.yaml: cannot be read"):
        load_nominal(tmp_path / "n.yaml")
