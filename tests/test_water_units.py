"""Water in SI units: what [air] and [stomata] mean for the rates of water loss, and what they refuse."""

from __future__ import annotations

from pathlib import Path

import pytest

from leafwarp.errors import InputError
from leafwarp.quantity import parse_quantity
from leafwarp.scene import Scene
from leafwarp.scene.file import load_scene
from leafwarp.scene.water import saturation_pressure

BASE = """
[leaf]
image = "leaf.png"
length = "12 cm"
[time]
duration = "2 h"
[fluid]
[structure]
membrane_stiffness = 6.0
water_mass = 0.45
"""
AIR = 'air.temperature="24.5 degC"'
DRYNESS = 'air.vapour_pressure_deficit="1.6 kPa"'
OPEN = 'stomata.open_conductance="30 mmol/m2/s"'
MINIMUM = 'stomata.minimum_conductance="1.3 mmol/m2/s"'
CLOSURE = "stomata.closure=[[0.8, 0.0], [1.0, 1.0]]"


def make_scene(tmp_path: Path, *changes: str) -> Scene:
    path = tmp_path / "units.toml"
    path.write_text(BASE)
    return load_scene(path, changes)


# Pressure of saturated vapour over water [Pa]: IAPWS-95 (Wagner and Pruss 2002).
SATURATED = {0.01: 611.66, 10.0: 1228.2, 20.0: 2339.3, 25.0: 3169.9, 30.0: 4247.0, 40.0: 7384.9, 50.0: 12352.0}


@pytest.mark.parametrize("celsius", SATURATED)
def test_saturated_vapour_has_the_pressure_of_the_tables(celsius: float) -> None:
    # The formula's own accuracy in this range, without the enhancement by air (0.4 %).
    assert saturation_pressure(celsius + 273.15) == pytest.approx(SATURATED[celsius], rel=6e-4)


def test_the_deficit_is_what_the_air_lacks(tmp_path: Path) -> None:
    scene = make_scene(tmp_path, 'air.temperature="25 degC"', "air.relative_humidity=0.6", OPEN, CLOSURE)
    # By hand: 611.21 exp((18.678 - 25/234.5) 25 / 282.14) = 3168.5 Pa, of which 40 % are missing.
    assert scene.air.deficit == pytest.approx(0.4 * 3168.5, rel=1e-4)
    percent = scene.with_changes({"air.relative_humidity": "60 %"})
    assert percent.air.deficit == pytest.approx(scene.air.deficit)
    assert scene.with_changes({"air.relative_humidity": 1}).transpiration.rate == 0.0


def test_rates_follow_from_conductance_and_deficit(tmp_path: Path) -> None:
    """By hand: 1600 / 101325 * 0.018015 / 0.45 = 6.3216e-4 m^2/mol, so 30 mmol/m2/s take 1.8965e-5 of y a second."""
    table = make_scene(tmp_path, AIR, DRYNESS, OPEN, MINIMUM, CLOSURE).transpiration
    assert table.rate == pytest.approx(1.8965e-5, rel=1e-4)
    assert table.cuticle_rate == pytest.approx(8.2180e-7, rel=1e-4)
    assert table.closure == ((0.8, 0.0), (1.0, 1.0))
    mountain = make_scene(tmp_path, AIR, DRYNESS, OPEN, MINIMUM, CLOSURE, 'air.pressure="700 hPa"').transpiration
    assert mountain.rate == pytest.approx(table.rate * 1013.25 / 700.0)
    assert make_scene(tmp_path, AIR, DRYNESS, OPEN, CLOSURE).transpiration.cuticle_rate == pytest.approx(
        5.1e-3 * 6.3216e-4, rel=1e-4
    )


def test_closure_is_proportional_to_turgor_by_default(tmp_path: Path) -> None:
    material = 'material={osmotic_potential = "1 MPa", bulk_modulus = "10 MPa", saturated_water = "450 g/m2"}'
    bare = BASE.replace("membrane_stiffness = 6.0\nwater_mass = 0.45\n", "")
    path = tmp_path / "material.toml"
    path.write_text(bare)
    scene = load_scene(path, [material, AIR, DRYNESS, OPEN, MINIMUM])
    (closed, none), (saturated, whole) = scene.transpiration.closure
    assert (closed, none, saturated, whole) == (pytest.approx(0.9), 0.0, 1.0, 1.0)
    assert scene.transpiration.rate == pytest.approx(1.8965e-5, rel=1e-4)
    other = scene.with_changes({"stomata.closure": ((0.5, 0.0), (0.6, 1.0))})
    assert other.transpiration.closure == ((0.5, 0.0), (0.6, 1.0))
    assert "stomata" in other.map_names


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("24.5 degC", "temperature", 297.65),
        ("24.5 °C", "temperature", 297.65),
        ("297.65 K", "temperature", 297.65),
        ("-5 degC", "temperature", 268.15),
        ("200 mmol/m2/s", "conductance", 0.2),
        ("200 mmol m-2 s-1", "conductance", 0.2),
        ("200 mmol m^-2 s^-1", "conductance", 0.2),
        ("200 mmol m⁻² s⁻¹", "conductance", 0.2),
        ("0.2 mol/m^2/s", "conductance", 0.2),
        ("1.6 kPa", "pressure", 1600.0),
        ("16 hPa", "pressure", 1600.0),
        ("9 bar", "pressure", 9e5),
        ("2e-10 m²/s", "diffusivity", 2e-10),
        ("450 g m-2", "mass per area", 0.45),
        ("65 %", "fraction", 0.65),
        ("0.65", "fraction", 0.65),
        ("20 1/h", "rate", 20.0 / 3600.0),
        ("20 /h", "rate", 20.0 / 3600.0),
        ("20/h", "rate", 20.0 / 3600.0),
        ("1/h", "rate", 1.0 / 3600.0),
        ("20 h^-1", "rate", 20.0 / 3600.0),
        ("20 h-1", "rate", 20.0 / 3600.0),
        ("20 h⁻¹", "rate", 20.0 / 3600.0),
        ("2e-3 s^-1", "rate", 2e-3),
    ],
)
def test_units_as_they_are_written(text: str, dimension: str, value: float) -> None:
    assert parse_quantity(text, dimension) == pytest.approx(value)


@pytest.mark.parametrize("text", ["200 mmol/m2", "200 mmol m2 s", "200 m2/mol/s", "mmol/m2/s"])
def test_what_is_no_conductance_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"accepted: a number .* mmol/m2/s"):
        parse_quantity(text, "conductance")


@pytest.mark.parametrize("value", ["20 h", "20 h^-2", "20 //h", "h^-1", "", True, [20], None])
def test_what_is_no_rate_is_refused(value: object) -> None:
    with pytest.raises(ValueError, match=r"^accepted: a number \[1/s\], or a number and one of 1/s, 1/min, 1/h, 1/d$"):
        parse_quantity(value, "rate")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (["air.relative_humidity=1.5"], ["air.relative_humidity = 1.5: accepted: 0 to 1", "65 %"]),
        (["air.relative_humidity=65"], ["air.relative_humidity = 65: accepted: 0 to 1", "65 %"]),
        (["air.relative_humidity=-0.1"], ["air.relative_humidity = -0.1: accepted: 0 to 1"]),
        (["air.temperature=5", DRYNESS], ["air.temperature = 5: accepted: 233.15 to 373.15 K", "in kelvin", "degC"]),
        (["air.temperature='5 degF'", DRYNESS], ["air.temperature = '5 degF': accepted: a number [K]", "K, degC"]),
        (["air.pressure=1.0", DRYNESS], ["air.pressure = 1.0: accepted: 1000 to 1e6 Pa"]),
        (["air.vapour_pressure_deficit=-1.0"], ["air.vapour_pressure_deficit = -1.0: accepted: 0 to 100000 Pa"]),
        ([AIR, "air.vapour_pressure_deficit=4e3"], ["air: vapour_pressure_deficit = 4000 Pa", "0 to 3075 Pa"]),
        ([DRYNESS, "air.relative_humidity=0.5"], ["either 'relative_humidity' or 'vapour_pressure_deficit'"]),
        (["stomata.open_conductance=-0.2"], ["stomata.open_conductance = -0.2: accepted: 0 to 100 mol/m2/s"]),
        (["stomata.open_conductance=200"], ["stomata.open_conductance = 200: accepted: 0 to 100 mol/m2/s"]),
        ([OPEN, "stomata.minimum_conductance=0.04"], ["stomata", "0.04 is more than open_conductance 0.03"]),
        ([OPEN, "stomata.closure=[[0.8, 0.0], [1.0, 1.2]]"], ["stomata.closure[1][1] = 1.2: accepted: 0 to 1"]),
        ([DRYNESS], ["[air] needs [stomata]"]),
        ([OPEN, CLOSURE], ["[stomata] needs [air]"]),
        ([DRYNESS, OPEN], ["stomata.closure: missing", "[material]"]),
        ([DRYNESS, OPEN, CLOSURE, "transpiration.rate=1e-5"], ["[transpiration] and [stomata] say the same"]),
        ([DRYNESS, OPEN, CLOSURE, "structure.water_mass=0.0"], ["structure.water_mass above 0"]),
        (["source.conductance=1e-3", "source.rewatered_at='1 h'"], ["rewatered_at = 3600 s", "no cut_at is given"]),
        (["source={conductance=1e-3, cut_at='2 h', rewatered_at='1 h'}"], ["cut_at is 7200 s", "a time after cut_at"]),
        (["source={conductance=1e-3, cut_at='1 h', rewatered_at='1 h'}"], ["cut_at is 3600 s", "a time after cut_at"]),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, changes: list[str], words: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        make_scene(tmp_path, *changes)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


def test_conductances_need_water_that_flows(tmp_path: Path) -> None:
    path = tmp_path / "prescribed.toml"
    path.write_text(BASE.replace("[fluid]", "[water]\ncurve = [[0.0, 1.0]]"))
    with pytest.raises(InputError, match=r"\[stomata\] needs \[fluid\]"):
        load_scene(path, [DRYNESS, OPEN, CLOSURE])


def test_what_the_drying_takes_for_granted_is_said(tmp_path: Path) -> None:
    (air,) = make_scene(tmp_path, "air.relative_humidity=0.6", OPEN, CLOSURE).warnings
    assert air.startswith("air.temperature: not given; 298.15 K is taken, at which a relative humidity of 0.6 is")
    assert "1267 Pa" in air  # 0.4 of 3168.5 Pa
    # A deficit says it all: the rates do not depend on the temperature.
    known = make_scene(tmp_path, DRYNESS, OPEN, CLOSURE)
    assert known.warnings == ()
    assert known.transpiration == make_scene(tmp_path, DRYNESS, AIR, OPEN, CLOSURE).transpiration
    (water,) = make_scene(tmp_path, "structure={membrane_stiffness=6.0}", DRYNESS, OPEN, CLOSURE).warnings
    assert water.startswith("structure.water_mass: not given; 0.25 kg/m2 of water are taken for the saturated leaf")


@pytest.mark.parametrize(
    ("changes", "keys"),
    [
        ([DRYNESS, OPEN, MINIMUM], []),
        ([DRYNESS, "stomata.open_conductance=5.0"], ["stomata.open_conductance = 5"]),
        ([DRYNESS, OPEN, "stomata.minimum_conductance=1e-5"], ["stomata.minimum_conductance = "]),
        (['air.temperature="80 degC"', "air.relative_humidity=0.1", OPEN], ["air.temperature", "air.deficit"]),
    ],
)
def test_unusual_values_are_warned_of(tmp_path: Path, changes: list[str], keys: list[str]) -> None:
    warnings = make_scene(tmp_path, *changes, CLOSURE).warnings
    assert len(warnings) == len(keys)
    for line, key in zip(warnings, keys, strict=True):
        assert line.startswith(key) and "usual: " in line and "\n" not in line
