"""Pictures through an acoustic modem, against a 3D Gaussian Splatting prior that both sides hold.

    import nvsprior

    engine = nvsprior.Engine()
    prior = nvsprior.Prior.open("prior.ply")
    encoder = nvsprior.Encoder(engine, prior, camera, quality=10)
    encoded = encoder.encode(frame, hint=start)  # uint8, (height, width, 3); later frames need no hint

    decoder = nvsprior.Decoder(engine, prior)
    decoded = decoder.decode(encoded.packet)  # decoded.picture equals encoded.picture

Lengths are in the prior's unit, times in seconds, angles in radians, unless a name says otherwise. Calls that work on
pixels release the GIL. An object that two threads use at once raises BusyError; an Engine and a Prior may be shared.
"""

from ._nvsprior import (
    Camera,
    Channel,
    Decoded,
    Decoder,
    Division,
    Encoded,
    Encoder,
    Engine,
    Hint,
    Keys,
    Pose,
    Prior,
    Received,
    Renderer,
    Topside,
    TopsideLink,
    VehicleLink,
    __version__,
    devices,
    join,
    map,
    split,
)
from .errors import (
    ArgumentError,
    BudgetError,
    BusyError,
    CameraError,
    CameraUnknownError,
    DeviceError,
    DeviceLostError,
    Error,
    FileError,
    ForeignError,
    ForkedError,
    InternalError,
    LimitError,
    ModemError,
    NewerError,
    NoStartError,
    OtherPriorError,
    OutOfMemoryError,
    PacketError,
    PriorError,
    ReplayedError,
    ResidualError,
    StateError,
)
from .link import Shown, Vehicle, link
from .measures import psnr, ssim

__all__ = [
    "ArgumentError",
    "BudgetError",
    "BusyError",
    "Camera",
    "CameraError",
    "CameraUnknownError",
    "Channel",
    "Decoded",
    "Decoder",
    "DeviceError",
    "DeviceLostError",
    "Division",
    "Encoded",
    "Encoder",
    "Engine",
    "Error",
    "FileError",
    "ForeignError",
    "ForkedError",
    "Hint",
    "InternalError",
    "Keys",
    "LimitError",
    "ModemError",
    "NewerError",
    "NoStartError",
    "OtherPriorError",
    "OutOfMemoryError",
    "PacketError",
    "Pose",
    "Prior",
    "PriorError",
    "Received",
    "Renderer",
    "ReplayedError",
    "ResidualError",
    "Shown",
    "StateError",
    "Topside",
    "TopsideLink",
    "Vehicle",
    "VehicleLink",
    "__version__",
    "devices",
    "join",
    "link",
    "map",
    "psnr",
    "split",
    "ssim",
]
