"""The fitted room for other programs: textures, glTF, Mitsuba, USD, Blender, cameras."""
