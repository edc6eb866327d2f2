"""All errors that RoboCorba raises on purpose, as one tree with the root RoboCorbaError (base.py).

| base            | module        | errors of                                                                        |
|-----------------|---------------|----------------------------------------------------------------------------------|
| MapError        | maps.py       | the map building agent and map files                                             |
| PathError       | paths.py      | the path planning agent                                                          |
| SimulationError | simulation.py | the simulation server, its Omni database, the 2D simulator, recordings, videos   |
| RobotError      | robots.py     | programs, motions, adaptors, plans and missions                                  |
| EventError      | events.py     | event channels and their federation                                              |
| ServiceError    | services.py   | processes, settings and the naming service                                       |
| OutputError     | files.py      | files that are written                                                           |
"""
