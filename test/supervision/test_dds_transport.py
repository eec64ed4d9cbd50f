from xml.etree import ElementTree

import pytest

from ftp_dent_ros import files
from ftp_dent_ros.errors import ConfigurationError
from ftp_dent_ros.supervision import transport


def test_the_shipped_profile_is_the_choice():
    with transport.profile(environment={}) as variables:
        assert variables == {transport.VARIABLE: str(files.find('shipped:transport.xml'))}


def test_what_the_user_has_set_stays():
    with transport.profile(environment={transport.VARIABLE: '/my/profile.xml'}) as variables:
        assert variables == {}


def addresses_in(variables):
    tree = ElementTree.parse(variables['FASTRTPS_DEFAULT_PROFILES_FILE'])
    name = '{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}address'
    return [element.text for element in tree.iter(name)]


@pytest.mark.parametrize(
    ('interface', 'environment'),
    [
        ('lo', {}),
        ('127.0.0.1', {}),
        ('', {'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}),
        ('', {'ROS_LOCALHOST_ONLY': '1'}),
    ],
)
def test_one_interface_alone(interface, environment):
    with transport.profile(interface, environment=environment) as variables:
        assert addresses_in(variables) == ['127.0.0.1']
        assert variables['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'SUBNET'


@pytest.mark.parametrize('interface', ['none0', '203.0.113.7', 'a' * 40])
def test_an_interface_that_is_not_here(interface):
    with (
        pytest.raises(ConfigurationError, match='no interface of this computer'),
        transport.profile(interface, environment={}),
    ):
        pass
