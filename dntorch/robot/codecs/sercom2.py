"""SerCom of the e-puck2, over Bluetooth (selector 3) or USB (selector 8).

All of `sercom`, and codes that move everything at once. Sources: ``Asercom2.c`` of
e-puck2/e-puck2_main-processor, ``uart_e-puck2.c`` of e-puck2/e-puck2_esp32.
"""

from dntorch.robot.codecs import sercom, wifi

ACTUATORS, ALL_SENSORS = 0xF7, 0xF8
RGB, BUTTON, FOUR_MICROPHONES, DISTANCE, CARD = 0xF6, 0xF5, 0xF4, 0xF3, 0xF2
USE_MAGNETOMETER, USE_PROXIMITY, USE_DISTANCE = 0xF1, 0xF0, 0xEF

ARGUMENTS = {
    **sercom.ARGUMENTS, ACTUATORS: 19, RGB: 12,
    USE_MAGNETOMETER: 1, USE_PROXIMITY: 1, USE_DISTANCE: 1,
}  # fmt: skip

ANSWERS = {
    **sercom.ANSWERS, ALL_SENSORS: "103s", BUTTON: "<B", FOUR_MICROPHONES: "<4H",
    DISTANCE: "<H", CARD: "<B",
}  # fmt: skip


def set_actuators(command: wifi.Command) -> bytes:
    """Code and the 19 bytes of a Wi-Fi command after its request; ``request`` is not sent."""
    return bytes([ACTUATORS]) + wifi.encode_command(command)[2:]


def read_actuators(arguments: bytes) -> wifi.Command:
    """The command in the 19 bytes; its ``request`` is 0."""
    return wifi.decode_command(bytes([wifi.COMMAND, 0]) + arguments)


def encode_sensors(sensors: wifi.Sensors) -> bytes:
    """The 103 bytes: those of Wi-Fi without the button, the last one 0."""
    return wifi.encode_sensors(sensors)[:102] + b"\0"


def decode_sensors(data: bytes) -> wifi.Sensors:
    """Sensors from 103 bytes; the button counts as not pressed.

    Raises:
        ProtocolError: another number of bytes.
    """
    if len(data) != 103:
        raise wifi.ProtocolError(f"{len(data)} bytes of sensors: 103 were expected")
    return wifi.decode_sensors(data[:102] + b"\0\0")
