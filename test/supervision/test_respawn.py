from ftp_dent_ros.supervision.processes import Respawn


def test_what_ends_soon_waits_longer_each_time_and_what_ran_well_does_not_wait():
    policy = Respawn()
    assert [policy.delay(1, 5.0) for _ in range(7)] == [1, 2, 4, 8, 16, 30, 30]
    assert policy.delay(-9, 61.0) == 0
    assert [policy.delay(0, 0.1) for _ in range(2)] == [1, 2]
