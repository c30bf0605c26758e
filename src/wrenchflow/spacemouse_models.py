"""SpaceMice by their USB numbers: what each model reports at most, and the rule that lets a person read one.

The doctor looks for them without opening any, and `collect.devices.spacemouse` opens them.
"""

from dataclasses import dataclass

RULE_FILE = "/etc/udev/rules.d/70-spacemouse.rules"

MAKER = 0x256F  # 3Dconnexion. Before that its devices were Logitech's, whose other devices are none of ours.
MAKER_THEN = 0x046D
_WIRED, _WIRELESS = 350, 500


@dataclass(frozen=True, kw_only=True)
class SpaceMouseModel:
    """What is known of a model.

    Attributes:
        name: As a person calls it.
        full_scale_counts: What an axis reports at full deflection; a strong hand gets some devices a little further.
        buttons: How many it has, of those that its button reports tell.
    """

    name: str
    full_scale_counts: int
    buttons: int = 2


_MODELS = {
    (MAKER_THEN, 0xC603): SpaceMouseModel(name="SpaceMouse Plus XT", full_scale_counts=_WIRED, buttons=11),
    (MAKER_THEN, 0xC605): SpaceMouseModel(name="CADMan", full_scale_counts=_WIRED, buttons=4),
    (MAKER_THEN, 0xC606): SpaceMouseModel(name="SpaceMouse Classic", full_scale_counts=_WIRED, buttons=11),
    (MAKER_THEN, 0xC621): SpaceMouseModel(name="Spaceball 5000", full_scale_counts=_WIRED, buttons=12),
    (MAKER_THEN, 0xC623): SpaceMouseModel(name="SpaceTraveler", full_scale_counts=_WIRED, buttons=8),
    (MAKER_THEN, 0xC625): SpaceMouseModel(name="SpacePilot", full_scale_counts=_WIRED, buttons=21),
    (MAKER_THEN, 0xC626): SpaceMouseModel(name="SpaceNavigator", full_scale_counts=_WIRED),
    (MAKER_THEN, 0xC627): SpaceMouseModel(name="SpaceExplorer", full_scale_counts=_WIRED, buttons=15),
    (MAKER_THEN, 0xC628): SpaceMouseModel(name="SpaceNavigator for Notebooks", full_scale_counts=_WIRED),
    (MAKER_THEN, 0xC629): SpaceMouseModel(name="SpacePilot Pro", full_scale_counts=_WIRED, buttons=31),
    (MAKER_THEN, 0xC62B): SpaceMouseModel(name="SpaceMouse Pro", full_scale_counts=_WIRED, buttons=15),
    (MAKER, 0xC62E): SpaceMouseModel(name="SpaceMouse Wireless, on its cable", full_scale_counts=_WIRELESS),
    (MAKER, 0xC62F): SpaceMouseModel(name="SpaceMouse Wireless", full_scale_counts=_WIRELESS),
    (MAKER, 0xC631): SpaceMouseModel(
        name="SpaceMouse Pro Wireless, on its cable", full_scale_counts=_WIRELESS, buttons=15
    ),
    (MAKER, 0xC632): SpaceMouseModel(name="SpaceMouse Pro Wireless", full_scale_counts=_WIRELESS, buttons=15),
    (MAKER, 0xC633): SpaceMouseModel(name="SpaceMouse Enterprise", full_scale_counts=_WIRED, buttons=31),
    (MAKER, 0xC635): SpaceMouseModel(name="SpaceMouse Compact", full_scale_counts=_WIRED),
    (MAKER, 0xC636): SpaceMouseModel(name="SpaceMouse Module", full_scale_counts=_WIRED),
    (MAKER, 0xC638): SpaceMouseModel(
        name="SpaceMouse Pro Wireless, on its cable", full_scale_counts=_WIRELESS, buttons=15
    ),
    (MAKER, 0xC63A): SpaceMouseModel(name="SpaceMouse Wireless", full_scale_counts=_WIRELESS),
    (MAKER, 0xC652): SpaceMouseModel(name="Universal Receiver", full_scale_counts=_WIRELESS, buttons=15),
}
# A model that is newer than this list: the smaller scale, with which it is too quick rather than never at full speed.
_NEWER = SpaceMouseModel(name="3Dconnexion device", full_scale_counts=_WIRED)


def model_of(vendor: int, product: int) -> SpaceMouseModel | None:
    """What is known of a device by its USB numbers; None where it is none to steer an arm with."""
    return _MODELS.get((vendor, product), _NEWER if vendor == MAKER else None)


def udev_rule(vendor: int) -> str:
    """The line that lets whoever sits at the machine read a maker's HID devices."""
    return f'KERNEL=="hidraw*", ATTRS{{idVendor}}=="{vendor:04x}", MODE="0660", TAG+="uaccess"'
