"""The map building agent: buildings, their rules and geometry, their store and their file formats. No CORBA here.

map_building_agent edits a building (model) in transactions (draft, changes), checked by validation and kept in store;
checking finds what robots can't do in it, topology draws its topological maps, formats reads and writes map files.
"""
