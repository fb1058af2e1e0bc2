"""What the package raises. The texts are those of the library: they name what failed and what to do."""


class Error(Exception):
    """Anything that fails in the library. All classes below are kinds of it."""


class ArgumentError(Error, ValueError):
    """An argument is out of its range, or does not fit the others. The text names it."""


class DeviceError(Error):
    """No Vulkan loader, no device that fits, or a Vulkan call that failed."""


class DeviceLostError(DeviceError):
    """The device was lost, or did not end its work in time. Make a new engine."""


class OutOfMemoryError(Error, MemoryError):
    """Host or device memory could not be allocated."""


class FileError(Error, OSError):
    """A file cannot be read or written."""


class PriorError(Error):
    """The content of a prior is not valid. The text names the splat or the byte."""


class CameraError(Error, ValueError):
    """No picture can be rendered with this camera."""


class NoStartError(Error):
    """No pose to start from: none was given, and the prior has no key frames."""


class BudgetError(Error):
    """The byte budget does not even hold the pose, or a packet's shares do not."""


class LimitError(Error):
    """A picture has more pixels than the decoder's limit."""


class PacketError(Error):
    """The bytes are no packet, or its latent part is damaged."""


class OtherPriorError(PacketError):
    """The packet is about another prior, or one before was and this one does not state its prior."""


class CameraUnknownError(PacketError):
    """The packet that states prior and camera is missing, or they are others."""


class ResidualError(Error):
    """The difference picture is damaged, cut short, or its reference frame is missing."""


class NewerError(Error):
    """It is of a newer format than this library knows. Update this side."""


class ModemError(Error):
    """The bytes are no modem frame of a packet, or the packet does not fit the modem."""


class ForeignError(ModemError):
    """No key that is held has made the tag: of a stranger or of another epoch, or damaged."""


class ReplayedError(ModemError):
    """It has the right tag, and comes a second time."""


class StateError(Error):
    """The call is not possible now: the text says what is due first."""


class ForkedError(StateError, RuntimeError):
    """The object was made in another process. Make it in the child, or start the child by spawn."""


class BusyError(Error):
    """Another thread is inside a call on this object."""


class InternalError(Error):
    """A fault of the library itself. The object cannot be used any more."""
