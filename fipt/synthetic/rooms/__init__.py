"""Rooms in code, one file each: their shell, emitters and furniture."""

from fipt.synthetic.rooms import bathroom, blinds, kitchen, living_room, office, skylight
from fipt.synthetic.rooms.design import RoomDesign

DEFAULT = "living_room"
"""The room of the demo."""

ROOMS: dict[str, RoomDesign] = {
    "living_room": living_room.DESIGN,
    "bathroom": bathroom.DESIGN,
    "office": office.DESIGN,
    "kitchen": kitchen.DESIGN,
    "blinds": blinds.DESIGN,
    "skylight": skylight.DESIGN,
}
"""Name -> room."""
