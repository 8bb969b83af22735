"""What goes over the wire, as pure functions on bytes: one file a protocol.

========== ===========================================================================
`wifi`     e-puck2 over TCP: 21-byte commands, packets of images and sensors
`sercom`   e-puck1 over a serial line: lines of text and chains of binary codes
`sercom2`  e-puck2 over a serial line: `sercom` with all sensors or actuators at once
`rgb565`   the pixels of all three
========== ===========================================================================
"""

from dntorch.robot.codecs.stream import ProtocolError, Stream

__all__ = ["ProtocolError", "Stream"]
