from ftp_dent_ros.supervision.respawn import Respawn


def test_the_delay_doubles_and_starts_anew_after_ten_seconds_of_running():
    policy = Respawn()
    assert [policy.delay(1, 5.0) for _ in range(7)] == [1, 2, 4, 8, 16, 30, 30]
    assert policy.delay(-9, 61.0) == 1
    assert policy.delay(0, 0.1) == 2


def test_wrong_parameters_are_not_tried_again_however_long_it_ran():
    assert Respawn().delay(2, 0.1) is None
    assert Respawn().delay(2, 600.0) is None
