"""All errors that RoboCorba raises on purpose, as one tree.

RoboCorbaError
├── MapError
│   ├── InvalidElement        an element breaks a rule of the building
│   ├── UnknownElement        nothing has this kind, floor and name
│   ├── DuplicateElement      something has this kind, floor and name already
│   ├── StaleEdit             the element changed since the editor read it
│   ├── StaleVersion          the building changed since the editor read it
│   ├── NothingToUndo, NothingToRedo
│   ├── VersionUnavailable    the history does not contain this version
│   ├── TransactionClosed, TooManyTransactions
│   └── MapFileError          a map file is invalid: file, line, key, reason
├── PathError
│   ├── InvalidPoint          a coordinate is not a finite number in range
│   ├── InvalidRequest        a field of the request is out of range
│   ├── UnknownFloor          the building has no such floor
│   ├── NotFree               start or goal is too close to an obstacle
│   └── NoPath                no path leads there; names the blockers
├── SensingError
│   ├── InvalidScan           a field of a scan request is out of range
│   └── SensorBehind          the sensor's floor state is too old
├── SimulationError
│   ├── InvalidDescription    a field of a robot's description is out of range
│   ├── PlaceTaken            the place is not free for the robot
│   ├── NameTaken             a robot of this name is logged on
│   ├── ServerFull            the limit of robots is reached; gives the limit, the number and when to retry
│   ├── SessionExpired        the robot is no longer logged on
│   ├── UnknownRobot          no robot of this name is logged on
│   ├── InvalidCommand        a velocity or its validity period is out of range
│   ├── CannotGrip            the object is out of reach, or can't be moved
│   ├── InvalidRide           a field of a call for an elevator is invalid
│   ├── ElevatorFull          too many robots wait for it
│   ├── InvalidReservation    a field of a reservation of areas is invalid
│   ├── ReservationsFull      too many robots have reserved areas
│   ├── NoRide                a robot has no ride, or not in this phase
│   ├── InvalidChoice         an administrator set an invalid value
│   ├── InvalidMission, StaleMission, UnknownMission
│   ├── InvalidPicture        a field of a request for a floor's picture is invalid
│   ├── VideoError, InvalidRecording   a film can't be written; a recording can't be read
│   ├── UpdateMismatch             a floor update does not continue the known version
│   └── SimulationBusy        the call was not executed for lack of time
├── RobotError
│   ├── InvalidProgram        an icon of a program is invalid: which one, which parameter, and why
│   ├── Unreachable           a hand can't reach the pose
│   ├── IllegalOrder          the robot can't execute the order in its state
│   ├── UnknownAdaptor        no adaptor has this name
│   ├── UnknownPlan           the data pool holds no plan of this name
│   ├── InvalidPlan, StalePlan
│   ├── InvalidCarry          this number of robots can't carry the object
│   ├── ImpossibleCarry       an object can't be carried there; names the blocking door, elevator or turn
│   ├── MotionFailed          the robot did not reach its goal
│   ├── MissionFailed         a cooperative mission failed: why, which robot, where
│   └── AdaptorFailed         the robot does not execute commands
│       ├── UnitFailed        a unit of the actual robot refuses: which one, its code, and why
│       └── RobotLost         the robot does not answer; it may return
├── EventError
│   ├── InvalidEvent          a field of an event is out of range
│   ├── InvalidSubscription   a subscription is invalid: which part, and why
│   ├── InvalidQueue          a setting of a queue is invalid
│   ├── TooManyProxies        the channel's limit of clients is reached
│   ├── AlreadyConnected      the proxy already has a client
│   ├── Disconnected          the proxy has no client
│   ├── ProxyGone             the proxy was disconnected, or its channel destroyed
│   ├── UnknownSubscription   no durable subscription has this name
│   ├── UnknownPeer           the channel has no such peer
│   ├── InvalidPeer           a peer can't be linked
│   ├── SessionOver           a gateway's session has ended; it must join again
│   ├── NotDelivered          a client did not receive an event; retry
│   ├── Unconfirmed           a client may have received an event; the reply is missing
│   ├── Refused               a client raised an exception for an event, or could not accept it
│   └── ClientGone            a client ended its connection
└── ServiceError
    ├── AlreadyRunning        another process uses this state folder
    ├── PortInUse             another process listens there
    ├── StateMismatch         the state folder contains another building
    ├── StartFailed           a process did not start in time
    ├── InvalidSetting        a variable or an option is invalid (in settings.py)
    └── NotReachable          a name could not be resolved or did not answer in time
"""
