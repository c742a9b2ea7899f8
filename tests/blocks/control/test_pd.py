"""PD control: its force, errors and units."""

from numpy.testing import assert_array_equal

from trussflow.blocks import PD


def test_force_is_against_errors_of_position_and_velocity(evaluate):
    now = {"position": [3.0, -1.0], "velocity": [5.0, 2.0]}
    wanted = {"reference_position": 1.0, "reference_velocity": 4.0}
    found = evaluate(PD([4.0, 9.0], [2.0, 3.0]), **now, **wanted)
    assert_array_equal(found["error"], [2.0, -2.0])
    assert_array_equal(found["error_rate"], [1.0, -2.0])
    assert_array_equal(found["force"], [-10.0, 24.0])


def test_units_are_checked_where_given():
    block = PD(2000.0, 2000.0, unit=("m", "rad"), force_unit=("N", "N*m"))
    assert block.velocity.unit == ("m/s", "rad/s")
    assert block.force.unit == ("N", "N*m")
