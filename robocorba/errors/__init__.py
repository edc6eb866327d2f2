"""Every error that RoboCorba raises on purpose, one tree with a sentence each.

RoboCorbaError
├── MapError
│   ├── InvalidElement        an element breaks a rule of the building
│   ├── UnknownElement        nothing has this kind, floor and name
│   ├── DuplicateElement      something has this kind, floor and name already
│   ├── StaleEdit             the element changed since the editor read it
│   ├── StaleVersion          the building changed since the editor looked
│   ├── NothingToUndo, NothingToRedo
│   ├── VersionUnavailable    the history does not reach back (or forward) that far
│   ├── TransactionClosed, TooManyTransactions
│   └── MapFileError          a map file is wrong: file, line, key, reason
├── PathError
│   ├── InvalidPoint          a coordinate is not a finite number in range
│   ├── InvalidRequest        a field of the request is out of range
│   ├── UnknownFloor          the building has no such floor
│   ├── NotFree               start or goal is too near to an obstacle
│   └── NoPath                nothing leads there: the blockers are named
├── SensingError
│   ├── InvalidScan           a field of a scan's request is out of range
│   └── SensorBehind          what the sensor knows is too old
├── SimulationError
│   ├── InvalidDescription    a field of a robot's description is out of range
│   ├── PlaceTaken            a robot would stand in something there
│   ├── NameTaken             a robot of this name is logged on
│   ├── ServerFull            as many robots are logged on as may be: the limit, how many, when to try again
│   ├── SessionExpired        the robot is not logged on any more
│   ├── UnknownRobot          no robot of this name is logged on
│   ├── InvalidCommand        a velocity, or how long it shall hold, can't be
│   ├── CannotGrip            the object is out of reach, or can't be moved
│   ├── InvalidRide           a field of a call for an elevator can't be
│   ├── ElevatorFull          too many robots wait for it
│   ├── InvalidReservation    a field of a reservation of areas can't be
│   ├── ReservationsFull      too many robots have reserved areas
│   ├── NoRide                a robot has no ride, or not in this phase
│   ├── InvalidChoice         an administrator set what can't be
│   ├── InvalidMission, StaleMission, UnknownMission
│   ├── InvalidPicture        a picture of a floor can't be drawn like this
│   ├── VideoError, StateDamaged   a film can't be written, a recording not be read
│   ├── OutOfStep             an update of a floor does not follow what is known
│   └── SimulationBusy        there was no time for it; nothing was done
├── RobotError
│   ├── InvalidProgram        an icon of a program can't be: which one, which parameter, and why
│   ├── Unreachable           a hand can't get there
│   ├── IllegalOrder          the robot can't do this now
│   ├── UnknownAdaptor        no adaptor has this name
│   ├── UnknownPlan           the data pool holds no plan of this name
│   ├── InvalidPlan, StalePlan
│   ├── InvalidCarry          so many robots can't carry this
│   ├── ImpossibleCarry       an object can't be carried there: the door, elevator or turn that blocks is named
│   ├── MotionFailed          the robot did not get where it should
│   ├── MissionFailed         what robots do together came to nothing: why, who, where
│   └── AdaptorFailed         the robot does not do what it is told
│       ├── UnitFailed        a unit of the actual robot refuses: which one, its code, and why
│       └── RobotLost         nobody answers any more; it may come back
├── EventError
│   ├── InvalidEvent          a field of an event is out of range
│   ├── InvalidSubscription   a subscription can't be used: where in it, and why
│   ├── InvalidQueue          a queue can't be made like this
│   ├── TooManyProxies        the channel serves as many clients as it may
│   ├── AlreadyConnected      the proxy has its client
│   ├── Disconnected          the proxy has no client, or has none any more
│   ├── ProxyGone             the proxy was disconnected, or its channel destroyed
│   ├── UnknownSubscription   no durable subscription has this name
│   ├── UnknownPeer           the channel has no such peer
│   ├── InvalidPeer           a peer can't be linked
│   ├── SessionOver           a gateway's session has ended; it has to join again
│   ├── NotDelivered          a client did not get an event: try again
│   ├── Unconfirmed           a client may have got an event: the answer did not come
│   ├── Refused               a client answered an event with an exception, or could not take it
│   └── ClientGone            a client ended its connection
└── ServiceError
    ├── AlreadyRunning        another process uses this state folder
    ├── PortInUse             somebody else listens there
    ├── StateMismatch         the state folder holds another building
    ├── StartFailed           a process did not come up in time
    ├── InvalidSetting        a variable or an option can't be used (in settings.py)
    └── NotReachable          a name could not be resolved or did not answer in time
"""
