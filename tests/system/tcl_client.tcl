# Calls every operation that clients call, over Combat instead of omniORB, and serves those that servers call:
#
#   tclsh tcl_client.tcl REPOSITORY HOST:PORT STATE_FOLDER CHANNEL ROBOT
#
# REPOSITORY has the IDL, HOST:PORT is that of the naming service, ROBOT a running robot. Prints a JSON list a line:
#
#   ["called", repository id]    an operation or attribute that was called, or was served
#   ["answer", name, value]      what the test compares with the same call in Python
#   ["failed", subject, why]     or ["passed", subject]

package require combat
lassign $argv repository naming folder channel_name robot_name
# 65537 is Latin-1: Combat sends names as UTF-8 unless that is its own code set.
corba::init -ORBNativeCodeSet 65537 -ORBHostName 127.0.0.1
source $repository
fconfigure stdout -encoding utf-8 -buffering line

# Longest wait for anything, ms.
set PATIENCE 60000

# ---- what it prints ----

proc quoted {text} {
    return "\"[string map [list \\ \\\\ \" \\\" \n \\n \r \\r \t \\t] $text]\""
}

# A value as JSON. Octets are hexadecimal digits, an enumerator its name, a union a list, an object whether it is there.
proc json {type value} {
    lassign $type kind id members cases
    switch -- $kind {
        struct - exception {
            set found {}
            foreach {name member} $members {lappend found "[quoted $name]: [json $member [dict get $value $name]]"}
            return "{[join $found {, }]}"
        }
        union {
            set of [dict get $cases [lindex $value 0]]
            return "\[[quoted [lindex $value 0]], [json $of [lindex $value 1]]\]"
        }
        sequence - array {
            if {$id eq "octet"} {return [quoted [binary encode hex $value]]}
            set found {}
            foreach element $value {lappend found [json $id $element]}
            return "\[[join $found {, }]\]"
        }
        boolean {return [expr {$value ? "true" : "false"}]}
        void {return null}
        any {return [json {*}$value]}
        Object {return [expr {$value eq "0" ? "false" : "true"}]}
        enum - string - char {return [quoted $value]}
        default {return $value}
    }
}

proc report {kind args} {
    puts "\[[quoted $kind], [join $args {, }]\]"
}

proc type_of {object} {
    return [[::Combat::CORBA::ORB::GetObjFromRef $object] cget -type_id]
}

# The description of an operation or attribute, as a dictionary.
proc described {type operation} {
    ::Combat::SimpleTypeRepository::HaveTypeInfoForId $type
    set found [::Combat::SimpleTypeRepository::getOp $type $operation]
    return [expr {$found ne "" ? $found : [::Combat::SimpleTypeRepository::getAttr $type $operation]}]
}

# Called after each call of an operation, whatever came of it.
proc note_call {command args} {
    set words [lrange $command 2 end]
    while {[string match -* [lindex $words 0]]} {set words [lrange $words [expr {[lindex $words 0] eq "-async" ? 1 : 2}] end]}
    set found [described [[lindex $command 1] cget -type_id] [lindex $words 0]]
    if {$found ne ""} {report called [quoted [dict get $found id]]}
}
trace add execution ::Combat::CORBA::ORB::object_invoke leave note_call

# Call an operation, and print its result under a name.
proc answer {name object operation args} {
    set value [$object $operation {*}$args]
    set found [described [type_of $object] $operation]
    set type [dict get $found [expr {[dict exists $found result] ? "result" : "type"}]]
    report answer [quoted $name] [json $type $value]
    return $value
}

# ---- what it checks ----

proc check {condition} {
    if {![uplevel 1 [list expr $condition]]} {error "not true: [uplevel 1 [list subst -nocommands $condition]]"}
}

# Run a script that raises an exception of the IDL, whose members have these values, or of CORBA.
proc refused {exception members script} {
    if {![catch {uplevel 1 $script} raised]} {error "$exception was not raised"}
    if {[catch {lassign $raised id found}]} {error $raised}
    if {$id ni [list "IDL:RoboCorba/$exception:1.0" "IDL:omg.org/$exception:1.0"]} {error "$raised instead of $exception"}
    foreach {name value} $members {
        if {[dict get $found $name] ne $value} {error "$name of $exception is [dict get $found $name], not $value"}
    }
    return $found
}

# Wait until a condition is true.
proc until {condition} {
    set ::late 0
    set timer [after $::PATIENCE {set ::late 1}]
    while {![uplevel 1 [list expr $condition]]} {
        if {$::late} {error "not in time: $condition"}
        after 20 {set ::tick 1}
        vwait ::tick
    }
    after cancel $timer
}

proc subject {name script} {
    if {[catch {uplevel #0 $script} raised options]} {
        report failed [quoted $name] [quoted [dict get $options -errorinfo]]
    } else {
        report passed [quoted $name]
    }
}

# The object with a name.
proc resolve {name} {
    return [corba::string_to_object corbaname::1.2@$::naming#RoboCorba/$name]
}

proc get {value args} {
    return [dict get $value {*}$args]
}

# The reference of a servant, which servers may call.
proc serve {servant} {
    set poa [corba::resolve_initial_references RootPOA]
    [$poa the_POAManager] activate
    return [$poa id_to_reference [$poa activate_object $servant]]
}

# To be called by the operations of servants.
proc served {interface operation} {
    report called [quoted [dict get [described [::Combat::SimpleTypeRepository::getRepoid $interface] $operation] id]]
}

set editor [resolve MapEditor]
set planner [resolve PathPlanner]

# ---- the naming service ----

subject naming {
    set root [corba::string_to_object corbaloc::1.2@$naming/NameService]
    check {[$root _is_a IDL:omg.org/CosNaming/NamingContextExt:1.0]}
    set name {{id RoboCorba kind {}} {id PathPlanner kind {}}}
    check {[[$root resolve $name] _is_equivalent $planner]}
    check {[[$root resolve_str RoboCorba/PathPlanner] _is_equivalent $planner]}
    check {[$root to_string $name] eq "RoboCorba/PathPlanner"}
    check {[$root to_name RoboCorba/PathPlanner] eq $name}
    answer url $root to_url :127.0.0.1:2809 RoboCorba/PathPlanner
    set rest [get [refused CosNaming/NamingContext/NotFound {why missing_node} {
        $root resolve {{id RoboCorba kind {}} {id Küche kind {}}}
    }] rest_of_name]
    check {$rest eq {{id Küche kind {}}}}

    set ours [$root bind_new_context {{id tcl kind {}}}]
    set inner [$ours new_context]
    $ours bind_context {{id inner kind context}} $inner
    $ours rebind_context {{id inner kind context}} $inner
    $ours bind {{id planner kind object}} $planner
    refused CosNaming/NamingContext/AlreadyBound {} {$ours bind {{id planner kind object}} $planner}
    $ours rebind {{id planner kind object}} $editor
    check {[[$root resolve_str tcl/planner.object] _is_equivalent $editor]}
    set found {}
    $ours list 0 none iterator
    check {$none eq {}}
    check {[$iterator next_one one]}
    check {[$iterator next_n 5 others]}
    $iterator destroy
    foreach each [list $one {*}$others] {lappend found [get [lindex [get $each binding_name] 0] id] [get $each binding_type]}
    check {[lsort -stride 2 $found] eq {inner ncontext planner nobject}}
    refused CosNaming/NamingContext/NotEmpty {} {$ours destroy}
    $ours unbind {{id planner kind object}}
    $ours unbind {{id inner kind context}}
    $root unbind {{id tcl kind {}}}
    $inner destroy
    $ours destroy
}

# ---- the map ----

proc wall {name x1 y1 x2 y2} {
    return [list WALL_ELEMENT [list name $name fromPoint [list x $x1 y $y1] toPoint [list x $x2 y $y2] height 2.5]]
}

proc element {kind floor name} {
    return [list kind $kind onFloor $floor name $name]
}

subject planner {
    answer release $planner release
    check {[$planner mapVersion] == [$editor currentVersion]}
    set west {floor L1 x 3.0 y 3.0}
    set top {floor L2 x 14.0 y 3.1}
    answer path $planner getPath $west $top
    set request [answer request $planner defaultRequest $west $top]
    dict set request alternatives 2
    dict set request mode GEOMETRIC
    dict set request best SHORTEST_TIME
    dict set request forbiddenAreas {{onFloor L1 polygon {{x 5 y 2} {x 6 y 2} {x 6 y 4}}}}
    answer paths $planner findPaths $request
    set around [refused NotFree {which goal obstacle {wall w}} {$planner getPath $west {floor L1 x 10.2 y 2.0}}]
    check {abs([get $around clearance] - 0.2) < 1e-9 && [get $around position x] == 10.2}
    refused UnknownFloor {which start floorName Küche known {L1 L2}} {$planner getPath {floor Küche x 0 y 0} $west}
    refused InvalidPoint {which goal field x} {$planner getPath $west {floor L1 x 1e9 y 0}}
    dict set request alternatives 10
    refused InvalidRequest {field alternatives} {$planner findPaths $request}
    dict set request alternatives 0
    dict set request avoidElevators E1
    set blockers [get [refused NoPath {} {$planner findPaths $request}] blockers]
    check {[get [lindex $blockers 0] id] eq [element ELEVATOR_ELEMENT {} E1]}
}

subject map {
    answer editor_release $editor release
    answer building $editor buildingName
    answer floors $editor floors
    answer outline $editor read [element FLOOR_ELEMENT {} L1]
    foreach {kind floor} {WALL L1 OBJECT L1 DOOR L1 AREA L1 NODE L2 EDGE L1 ELEVATOR {}} {
        answer elements_$kind $editor elements ${kind}_ELEMENT $floor
    }
    set before [$editor currentVersion]
    set created [$editor create L1 [wall Küche 2.0 1.0 4.0 1.0]]
    check {$created > $before && [$editor currentVersion] == $created}
    set id [element WALL_ELEMENT L1 Küche]
    answer record $editor read $id
    refused DuplicateElement [list id $id] {$editor create L1 [wall Küche 2.0 1.0 4.0 1.0]}
    refused InvalidElement [list id [element WALL_ELEMENT L1 v]] {$editor create L1 [wall v 2.0 1.0 2.0 1.0]}
    set changed [$editor change L1 [wall Küche 2.0 1.0 5.0 1.0] $created]
    refused StaleEdit [list id $id expected $created current $changed] {
        $editor change L1 [wall Küche 2.0 1.0 6.0 1.0] $created
    }
    set renamed [$editor rename $id 厨房 $changed]
    refused UnknownElement [list id $id] {$editor read $id}
    set id [element WALL_ELEMENT L1 厨房]
    check {[get [lindex [get [$editor read $id] value] 1] toPoint x] == 5.0}
    set undone [$editor undo $renamed]
    refused StaleVersion [list expected $renamed current $undone] {$editor redo $renamed}
    set redone [$editor redo $undone]
    refused NothingToRedo {} {$editor redo $redone}
    $editor remove $id $redone
    answer changes $editor changesSince $before
    answer edits $editor editsSince $before
    refused VersionUnavailable [list asked 99 current [$editor currentVersion]] {$editor changesSince 99}
    answer check $editor check
    answer check_floor $editor checkFloor L1 0.3
    refused UnknownElement [list id [element FLOOR_ELEMENT {} L9]] {$editor checkFloor L9 0.3}
}

subject pages {
    set walls {kinds {WALL_ELEMENT NODE_ELEMENT} onFloor L1}
    answer page $editor readElements 0 $walls 2
    set taken [get [$editor readElements 0 $walls 2] next]
    answer next_page $editor readElements $taken $walls 2
    answer change_page $editor readChanges {since 1 taken 0} {kinds {} onFloor {}} 3
}

subject documents {
    set document [answer document $editor exportMap]
    set imported [$editor importMap $document [$editor currentVersion]]
    check {[$editor exportMap] eq $document}
    refused StaleVersion [list expected 1] {$editor importMap $document 1}
    set why [refused InvalidMap {} {$editor importMap "floors: \[\n" $imported}]
    check {[get $why line] > 0}
    set built [$editor buildTopologicalMap L2 0.4]
    $editor undo $built

    answer no_picture $editor getUnderlay L1
    set picture [binary decode base64 \
        iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNgAAAAAgABSK+kcQAAAABJRU5ErkJggg==]
    $editor setUnderlay L1 [list picture $picture origin {x 1.0 y 2.0} resolution 0.05]
    answer picture $editor getUnderlay L1
    refused UnknownElement {} {$editor getUnderlay L9}
    $editor setUnderlay L1 {picture {} origin {x 0.0 y 0.0} resolution 0.05}
}

subject transaction {
    set before [$editor currentVersion]
    set transaction [$editor begin]
    $transaction create L1 {NODE_ELEMENT {name n1 at {x 3.0 y 7.0} inElevator {}}}
    $transaction create L1 {EDGE_ELEMENT {name e1 fromNode n1 toNode n2 directed 1 speedLimit 0.25 clearance 0.0
        graphs {g h}}}
    check {[$editor currentVersion] == $before}
    answer problems $transaction problems
    $transaction create L1 {NODE_ELEMENT {name n2 at {x 5.0 y 6.5} inElevator {}}}
    $transaction change L1 {NODE_ELEMENT {name n1 at {x 3.0 y 6.0} inElevator {}}} 0
    check {[$transaction problems] eq {}}
    set version [$transaction commit]
    answer edge $editor read [element EDGE_ELEMENT L1 e1]
    refused TransactionClosed {} {$transaction commit}
    set transaction [$editor begin]
    $transaction remove [element EDGE_ELEMENT L1 e1] $version
    $transaction remove [element NODE_ELEMENT L1 n2] $version
    $transaction remove [element NODE_ELEMENT L1 n1] $version
    $transaction commit
    set transaction [$editor begin]
    $transaction rollBack
    refused TransactionClosed {} {$transaction create L1 [wall w9 0.0 0.0 1.0 0.0]}
}

subject session {
    set session [$editor openSession Ada]
    check {[$session author] eq "Ada" && [$session undoable] eq {} && [$session redoable] eq {}}
    refused NothingToUndo {} {$session undo}
    set created [$session create L1 [wall s1 2.0 1.0 4.0 1.0]]
    set changed [$session change L1 [wall s1 2.0 1.0 3.0 1.0] $created]
    set renamed [$session rename [element WALL_ELEMENT L1 s1] s2 $changed]
    check {[string match {*s1*} [$session undoable]]}
    answer edits_of_Ada $editor editsSince [expr {$created - 1}]
    $session undo
    check {[string match {*s1*} [$session redoable]]}
    $session redo
    set transaction [$session begin]
    $transaction create L1 [wall s3 2.0 2.0 4.0 2.0]
    $transaction commit
    set found [$editor read [element WALL_ELEMENT L1 s3]]
    $editor change L1 [wall s3 2.0 2.0 5.0 2.0] [get $found changedAt]
    refused EditedByOthers [list id [element WALL_ELEMENT L1 s3] author {}] {$session undo}
    foreach name {s2 s3} {
        set id [element WALL_ELEMENT L1 $name]
        $session remove $id [get [$editor read $id] changedAt]
    }
    $session close
    refused CORBA/OBJECT_NOT_EXIST {completion_status COMPLETED_NO} {$session undo}
    set author [string repeat x 61]
    refused InvalidElement {} {$editor openSession $author}
}

subject proposals {
    set corners {{x 4.0 y 7.0} {x 4.5 y 7.0} {x 4.5 y 7.5}}
    set name [$editor propose L1 $corners 0.5 camera]
    check {[$editor propose L1 $corners 0.5 厨房] eq $name}
    set offered [answer proposals $editor proposals]
    check {[llength $offered] == 1 && [get [lindex $offered 0] name] eq $name}
    refused InvalidElement {} {$editor propose L1 $corners 1.5 camera}
    set session [$editor openSession Ada]
    set version [$session acceptProposal $name]
    set id [element OBJECT_ELEMENT L1 $name]
    refused UnknownElement {} {$session acceptProposal $name}
    $session remove $id $version
    $session close
    $editor rejectProposal [$editor propose L1 $corners 0.5 camera]
    check {[$editor proposals] eq {}}
    refused UnknownElement {} {$editor rejectProposal $name}
}

subject facts {
    set stool {OBJECT_ELEMENT {name stool footprint {CIRCLE_SHAPE 0.2} at {x 4.0 y 7.0} heading 0.0 height 0.5
        movable 1}}
    set id [element OBJECT_ELEMENT L1 stool]
    set all {kinds {OBJECT_ELEMENT} onFloor L1}
    set transaction [$editor begin]
    $transaction create L1 $stool
    $transaction setFact [list id $id key mass value 8] 0
    set version [$transaction commit]
    set fact [lindex [$editor readFacts $all] 0]
    check {[get $fact id] eq $id && [get $fact key] eq "mass" && [get $fact value] == 8}
    set heavier [$editor setFact [list id $id key mass value 12.5] $version]
    refused StaleEdit [list id $id expected $version] {$editor setFact [list id $id key mass value 1] $version}
    set session [$editor openSession Ada]
    set none [$session setFact [list id $id key mass value 0] $heavier]
    check {[$editor readFacts $all] eq {}}
    $session remove $id $none
    $session close
}

# ---- the simulation ----

set simulation [resolve SimulationServer]
set database [resolve OmniDatabase]
set administrator [corba::string_to_object file://$folder/administrator.ior]

proc register {name x y {floor L1}} {
    return [$::simulation registerRobot [list name $name start [list floor $floor x $x y $y heading 0.0] radius 0.3 \
        mass 50.0 limits {speed 1.0 turn 2.0 acceleration 2.0 turnAcceleration 4.0}]]
}

proc strip {x1 x2} {
    return [list onFloor L1 polygon [list "x $x1 y 7" "x $x2 y 7" "x $x2 y 9" "x $x1 y 9"]]
}

proc names {structures member} {
    return [lsort [lmap each $structures {dict get $each $member}]]
}

itcl::class StopTarget {
    inherit PortableServer::ServantBase
    public variable answer {stopped 0 confirmed 0 reason {}}

    public method _Interface {} {return ::RoboCorba::StopTarget}

    public method stop {reason} {
        set answer [list stopped 1 confirmed 1 reason $reason]
        served RoboCorba::StopTarget stop
        return $answer
    }
}

itcl::class NumberedStopTarget {
    inherit StopTarget
    public variable last 0

    public method stopNumbered {reason number} {
        set answer [list stopped 1 confirmed 1 reason $reason]
        set last $number
        served RoboCorba::StopTarget stopNumbered
        return $answer
    }
}

subject registration {
    answer simulation_release $simulation release
    refused NameTaken [list name $robot_name] {register $robot_name 8.0 1.0}
    refused PlaceTaken [list by $robot_name] {register T 3.2 5.0}
    refused UnknownFloor {which start floorName L9} {register T 1.0 1.0 L9}
    refused InvalidDescription {field name} {register {a b} 8.0 1.0}
    set limit [get [$simulation state] limit]
    $administrator setLimit 1
    check {[get [$simulation state] limit] == 1}
    set full [refused ServerFull {limit 1 now 1} {register T 8.0 1.0}]
    check {[get $full retryAfter] > 0}
    $administrator setLimit $limit
    refused InvalidSetting {field robots} {$administrator setLimit 1000000}
    check {[names [$simulation sensors] name] eq "s1"}
    check {[string match "\x89PNG*IHDR*" [$simulation renderFloor L1 200]]}
    refused InvalidPicture {field width} {$simulation renderFloor L1 1}
    refused UnknownFloor {floorName L9} {$simulation renderFloor L9 300}
}

subject robot_session {
    set robot [register T 8.0 2.0]
    check {[$robot name] eq "T" && [$robot lease] > 0}
    check {[names [$simulation clients] name] eq [lsort [list $robot_name T]]}
    set at [get [$robot state] at]
    until {[$robot command {ahead 0.3 left 0.0 turn 0.0} 0.5] eq {} && [get [$robot state] at x] > [get $at x] + 0.05}
    refused InvalidCommand {field validFor} {$robot command {ahead 0.1 left 0.0 turn 0.0} 6.0}
    $robot brake
    until {[get [$robot state] moving ahead] == 0.0}
    $robot reportPosture {0.25 -0.5}
    until {{robot T joints {0.25 -0.5}} in [lmap each [$database postures L1 0.0] {dict remove $each time}]}
    set sensor [$robot sensor]
    set spec [$sensor laser]
    set at [get [$robot state] at]
    set scan [$sensor scan $at {ahead 0.0 left 0.0 heading 0.0} $spec]
    check {[llength [get $scan distances]] == [get $spec rays]}
    check {abs([lindex [get $scan distances] 90] - (10.0 - [get $at x])) < 1e-6}
    until {"T" in [names [$database scansSince L1 0.0] robot]}
    until {[$robot heartbeat] eq {} && "T" in [names [$database lastScans L1] robot]}
}

subject elevator {
    refused InvalidRide {field elevator} {$robot callElevator E9 L2}
    $robot callElevator E1 L2
    check {[get [$robot state] riding origin] eq "L1" && [get [$robot state] riding destination] eq "L2"}
    until {[get [$robot state] riding phase] eq "BOARDING"}
    check {[$robot longestElevatorWait] == 0.0}
    $robot giveUpElevator
    check {[get [$robot state] riding phase] eq "NO_RIDE"}
    $robot callElevatorTogether E1 L2 party 2
    $robot giveUpElevator
    refused InvalidRide {field boardingTime} {$robot callElevatorFor E1 L2 party 2 99.0}
    $robot callElevatorFor E1 L2 party 2 30.0
    $robot giveUpElevator
    until {[$robot heartbeat] eq {} && [get [lindex [$database elevators] 0] doors] eq "CLOSED"}
}

subject grip {
    $editor create L1 {OBJECT_ELEMENT {name crate footprint {CIRCLE_SHAPE 0.25} at {x 8.0 y 6.0} heading 0.0 height 0.5
        movable 1}}
    set silent [register S 7.2 6.0]
    set refusal [refused CannotGrip {what sofa} {$silent grip sofa {x 7.8 y 6.0}}]
    check {[string match "there is no *" [get $refusal reason]]}
    until {[$robot heartbeat] eq {} && ![catch {$silent grip crate {x 7.75 y 6.0}}]}
    check {[get [$silent state] holding] eq "crate"}
    $silent release
    check {[get [$silent state] holding] eq {}}
    $silent grip crate {x 7.75 y 6.0}
}

subject reservations {
    $silent reserveAreas [list [strip 1 2] [strip 3 4]] 300.0
    check {[get [$silent reservation] phase] eq "AREAS_GRANTED"}
    $robot reserveAreas [list [strip 2 3.5]] 60.0
    check {[get [$robot reservation] phase] eq "WAITING_FOR_AREAS" && [get [$robot reservation] ahead] == 1}
    $robot releaseAreas
    check {[$robot reserveOneOf [list [list [strip 1 3]] [list [strip 6 7]]] 60.0] == 1}
    check {![$robot exchangeAreas [list [strip 1 2]] 10.0]}
    check {[$robot exchangeAreas [list [strip 5 6] [strip 6 7]] 10.0]}
    $robot keepAreas [list [strip 6 7]]
    set found [lsearch -inline -index 1 [$database reservations] T]
    check {[llength [get $found areas]] == 1 && [get $found state phase] eq "AREAS_GRANTED"}
    refused InvalidReservation {field limit} {$robot reserveAreas [list [strip 6 7]] 1000.0}
    refused UnknownFloor {floorName L9} {$robot reserveAreas {{onFloor L9 polygon {{x 0 y 0} {x 1 y 0} {x 1 y 1}}}} 9.0}
    $robot releaseAreas
    $silent heartbeat
    until {[$robot heartbeat] eq {} && "S" ni [names [$simulation clients] name]}
    refused CORBA/OBJECT_NOT_EXIST {} {$silent state}
    $robot takeOverAreas S
    check {[get [$robot reservation] phase] eq "AREAS_GRANTED"}
    refused InvalidReservation {} {$robot takeOverAreas nobody}
}

subject emergency_stop {
    set target [serve [StopTarget #auto]]
    $robot reportStopTarget $target 1
    set stopped [lindex [$simulation stopRobots {T nobody} {a test}] 0]
    check {[get $stopped robot] eq "T" && [get $stopped held]}
    until {[$robot heartbeat] eq {} && [get [lindex [$simulation stopStates T] 0] confirmed]}
    check {[$target answer] eq {stopped 1 confirmed 1 reason {a test}}}
    refused InvalidCommand {field stopped} {$robot command {ahead 0.1 left 0.0 turn 0.0} 0.5}
    $robot resetStop
    $robot command {ahead 0.0 left 0.0 turn 0.0} 0.5
    $simulation stopRobots T again
    $administrator resetStop T
    $robot command {ahead 0.0 left 0.0 turn 0.0} 0.5
    set before [$robot hold]
    check {[get $before number] > 0 && ![get $before held]}
    check {[$robot reportStop {by itself} now] && [get $now held] && [get $now reason] eq {by itself}}
    set number [get $now number]
    check {$number > [get $before number] && ![$robot reportStop again now] && [get $now number] == $number}
    set target [serve [NumberedStopTarget #auto]]
    $robot reportStopTarget $target 1
    $simulation stopRobots T later
    check {[get [$robot endStops $number] reason] eq "later"}
    until {[$robot heartbeat] eq {} && [get [lindex [$simulation stopStates T] 0] confirmed]}
    check {![get [$robot endStops [get [$robot hold] number]] held]}
    $robot command {ahead 0.0 left 0.0 turn 0.0} 0.5
    $administrator resetStop nobody
    check {[$simulation stopOfAll] eq {held 0 number 0 reason {}} && ![get [$simulation endStopOfAll 1] held]}
    refused UnknownRobot {name nobody} {$administrator resetStop nobody}
}

subject administrator {
    $administrator place T {floor L2 x 4.0 y 4.0 heading 1.0}
    check {[get [$robot state] at] eq {floor L2 x 4.0 y 4.0 heading 1.0}}
    refused UnknownBody {name nobody} {$administrator place nobody {floor L2 x 4.0 y 4.0 heading 1.0}}
    $administrator pause
    check {[get [$simulation state] paused]}
    set time [get [$simulation state] time]
    $administrator step 50
    check {abs([get [$simulation state] time] - $time - 1.0) < 0.021}
    $administrator resume
    $administrator setPace 2.0
    check {[get [$simulation state] pace] == 2.0}
    $administrator setPace 1.0
    $administrator evict T
    refused CORBA/OBJECT_NOT_EXIST {} {$robot heartbeat}
    refused UnknownRobot {name T} {$administrator evict T}
    check {![$administrator keepOut T]}
    check {"T" in [$administrator keptOut]}
    check {[$administrator admit T]}
    set robot [register T 4.0 4.0 L2]
    $robot deregister
    refused CORBA/OBJECT_NOT_EXIST {} {$robot deregister}
    set crate [element OBJECT_ELEMENT L1 crate]
    $editor remove $crate [get [$editor read $crate] changedAt]
    until {"crate" ni [names [get [$database typedFloorChanges L1 0] came] name]}
}

# ---- sensors and the Omni database ----

subject sensor {
    set sensor [resolve VirtualSensors/s1]
    answer sensor_release $sensor release
    set spec [answer laser $sensor laser]
    set ring [answer proximity $sensor proximity 0.3]
    refused InvalidScan {field rim} {$sensor proximity -1.0}
    set mount {ahead 0.1 left 0.05 heading 0.2}
    answer scan $sensor scan {floor L2 x 13.0 y 5.0 heading 0.5} $mount $spec
    dict set spec noise {sigma 0.01 relative 0.02 lost 0.1 seed 7}
    answer noisy_scans $sensor scanMany {{floor L2 x 13.0 y 5.0 heading 0.5} {floor L2 x 14.0 y 4.0 heading 0.0}} $mount $spec
    check {[get [$sensor load] busy] >= 0.0}
    refused UnknownFloor {floorName L9} {$sensor scan {floor L9 x 7.0 y 2.0 heading 0.5} $mount $ring}
    set own [$sensor forRobot nobody]
    answer own_scan $own scan {floor L2 x 16.4 y 5.0 heading 0.5} $mount $ring
    $sensor dismiss nobody
    dict set ring rays 10000
    refused InvalidScan {field rays} {$sensor scan {floor L1 x 7.0 y 2.0 heading 0.5} $mount $ring}
}

subject database {
    answer database_release $database release
    answer database_floors $database floors
    answer elevators $database elevators
    set typed [$database typedFloorChanges L1 0]
    set raw [$database getFloor L1]
    check {[names [get $typed came] name] eq [lsort [list $robot_name]]}
    foreach motion [get $typed motions] {
        binary scan [get $raw motions] iurrrqqq number vx vy turn x y heading
        check {[get $motion number] == $number && [get $motion x] == $x && [get $motion heading] == $heading}
    }
    set since [$database floorChanges L1 [get $raw current]]
    check {[get $since since] == [get $raw current] && [get $since came] eq {}}
    refused UnknownFloor {floorName L9 known {L1 L2}} {$database typedFloorChanges L9 0}

    set document [encoding convertto utf-8 {{"name": "Küche"}}]
    check {[$database putMission [list name tcl current 0 document $document]] == 1}
    check {[$database putMission [list name tcl current 1 document $document]] == 2}
    refused StaleMission {name tcl expected 1 current 2} {
        $database putMission [list name tcl current 1 document $document]
    }
    refused InvalidMission {field name} {$database putMission {name {} current 0 document {}}}
    check {[$database mission tcl] eq [list name tcl current 2 document $document]}
    check {"tcl" in [names [$database missions] name]}
    $database removeMission tcl
    refused UnknownMission {name tcl} {$database mission tcl}
}

# ---- events ----

itcl::class PlainConsumer {
    inherit PortableServer::ServantBase
    public variable values {}
    public variable disconnected 0

    public method _Interface {} {return ::CosEventComm::PushConsumer}

    public method push {value} {
        lappend values $value
        served CosEventComm::PushConsumer push
    }

    public method disconnect_push_consumer {} {
        set disconnected 1
        served CosEventComm::PushConsumer disconnect_push_consumer
    }
}

itcl::class Consumer {
    inherit PlainConsumer
    public variable runs {}
    public variable together {}

    public method _Interface {} {return ::RoboCorba::EventConsumer}

    public method pushRuns {some} {
        lappend runs {*}$some
        served RoboCorba::EventConsumer pushRuns
    }

    public method pushTogether {which events} {
        lappend together $which $events
        served RoboCorba::EventConsumer pushTogether
    }
}

# Supplies two values to a channel that pulls, and then none.
itcl::class PulledSupplier {
    inherit PortableServer::ServantBase
    private variable left {1 2}
    public variable disconnected 0

    public method _Interface {} {return ::CosEventComm::PullSupplier}

    public method pull {} {corba::throw IDL:omg.org/CosEventComm/Disconnected:1.0}

    public method try_pull {has_event} {
        upvar $has_event has
        set left [lassign $left value]
        set has [expr {$value ne {}}]
        served CosEventComm::PullSupplier try_pull
        return [list long [expr {$has ? $value : 0}]]
    }

    public method disconnect_pull_supplier {} {
        set disconnected 1
        served CosEventComm::PullSupplier disconnect_pull_supplier
    }
}

itcl::class PullConsumer {
    inherit PortableServer::ServantBase
    public method _Interface {} {return ::CosEventComm::PullConsumer}
    public method disconnect_pull_consumer {} {served CosEventComm::PullConsumer disconnect_pull_consumer}
}

proc event {type source payload {encoding MSGPACK}} {
    return [list header [list type $type source $source origin {} number 0 time 0.0 priority 0 expiry 0.0 \
        encoding $encoding] payload $payload]
}

proc clauses {args} {
    return [lmap type $args {list patterns [list [list type $type source *]] window 0.0}]
}

set channel [resolve EventChannels/$channel_name]
set queue {size 100 whenFull DISCARD_OLDEST blockLimit 0.0}
set codec [[corba::resolve_initial_references CodecFactory] create_codec {format 0 major_version 1 minor_version 2}]
set point {kind ELEVATOR_ENTRY node n position {floor L1 x 0.5 y -0.25} heading 1.0 distance 2.0 time 3.0 elevator {}}

subject plain_events {
    set ours [PlainConsumer #auto]
    set proxy [[$channel for_consumers] obtain_push_supplier]
    $proxy connect_push_consumer [set reference [serve $ours]]
    refused CosEventChannelAdmin/AlreadyConnected {} {$proxy connect_push_consumer $reference}
    set pulled [[$channel for_consumers] obtain_pull_supplier]
    $pulled connect_pull_consumer [serve [PullConsumer #auto]]
    $pulled try_pull has
    check {!$has}

    set pusher [[$channel for_suppliers] obtain_push_consumer]
    refused CosEventComm/Disconnected {} {$pusher push {long 1}}
    $pusher connect_push_supplier 0
    set wall [list [corba::type of RoboCorba::Element] [wall w 0.5 1.0 2.0 4.0]]
    set sent [list {string Küche} {long -7} [list [corba::type of RoboCorba::PathPoint] $point] $wall]
    foreach value $sent {$pusher push $value}
    until {[lmap value [$ours cget -values] {expr {$value in $sent ? $value : [continue]}}] eq $sent}
    set found {}
    while {[lindex $found end] ne [lindex $sent 0]} {lappend found [$pulled pull]}
    until {[$pulled try_pull has] eq [lindex $sent end] && $has}
    $pusher disconnect_push_consumer

    set supplier [PulledSupplier #auto]
    set puller [[$channel for_suppliers] obtain_pull_consumer]
    $puller connect_pull_supplier [serve $supplier]
    until {{long 2} in [$ours cget -values]}
    $puller disconnect_pull_consumer
    until {[$supplier cget -disconnected]}
    $pulled disconnect_pull_supplier
    refused CORBA/OBJECT_NOT_EXIST {} {$pulled pull}
    $proxy disconnect_push_supplier
    until {[$ours cget -disconnected]}
}

subject events_with_headers {
    check {[$channel name] eq $channel_name}
    answer channel_release $channel release
    answer peers $channel peers
    check {[$channel routeBack] eq "0"}
    set ours [Consumer #auto]
    set reference [serve $ours]
    set proxy [$channel subscribe durable $reference [clauses tcl.* IDL:RoboCorba/*] $queue]
    set supplier [$channel supply Küche]
    $supplier pushEvent [event tcl.one Küche \x01]
    set run [list first [get [event tcl.two Küche {}] header] times {1e9 2e9} payloads [list \x02 \x00\xff]]
    $supplier pushRuns [list $run]
    until {[llength [$ours cget -runs]] == 2}
    lassign [$ours cget -runs] one two
    check {[get $one first origin] eq $channel_name && [get $one payloads] eq "\x01"}
    check {[get $two first source] eq "Küche" && [get $two times] eq {1000000000.0 2000000000.0}}
    check {[get $two payloads] eq [list \x02 \x00\xff] && [get $two first number] == [get $one first number] + 1}
    refused InvalidEvent {field type} {$supplier pushEvent [event {} Küche {}]}
    check {[get [$supplier state] events received] >= 3 && [get [$supplier state] name] eq "Küche"}

    $proxy suspend
    check {[get [$proxy state] condition] eq "SUSPENDED"}
    $supplier pushEvent [event tcl.point Küche [$codec encode [list [corba::type of RoboCorba::PathPoint] $point]] CDR_ANY]
    until {[get [$proxy state] events queued] == 1}
    $proxy resume
    until {[llength [$ours cget -runs]] == 3}
    set value [$codec decode [lindex [get [lindex [$ours cget -runs] 2] payloads] 0]]
    check {[lindex $value 1] eq $point && [lindex $value 0 1] eq "IDL:RoboCorba/PathPoint:1.0"}

    set both {{patterns {{type tcl.a source *} {type tcl.b source B}} window 5.0}}
    $proxy changeSubscription $both
    refused InvalidSubscription {} {$proxy changeSubscription {{patterns {} window 0.0}}}
    refused UnknownPeer {peer nobody} {$proxy isInForceAt nobody}
    $supplier pushEvent [event tcl.b B {}]
    $supplier pushEvent [event tcl.a A {}]
    until {[$ours cget -together] ne {}}
    lassign [$ours cget -together] which events
    check {$which == 0 && [lmap each $events {dict get $each header type}] eq {tcl.a tcl.b}}

    set state [$channel state]
    check {[get $state name] eq $channel_name && "durable" in [names [get $state proxies] name]}
    check {$channel_name in [names [get [$channel traffic] origins] origin]}
    $proxy disconnect_push_supplier
    refused UnknownSubscription {name nobody} {$channel unsubscribe nobody}
    $channel unsubscribe durable
    set why [refused InvalidQueue {field size} {
        $channel subscribe {} $reference [clauses *] {size 0 whenFull BLOCK_SUPPLIER blockLimit 0.0}
    }]
    refused UnknownPeer {peer nobody} {$channel removePeer nobody}
    refused InvalidPeer {field name} {$channel addPeer {name {} address 127.0.0.1:1 foreign 0}}
}

subject pull_with_subscription {
    set pulled [[$channel for_consumers] obtain_pull_supplier]
    check {[$pulled _is_a IDL:RoboCorba/EventProxyPullSupplier:1.0]}
    $pulled changeSubscription [clauses tcl.pulled]
    $pulled connect_pull_consumer 0
    set supplier [$channel supply tcl]
    $supplier pushEvent [event tcl.other tcl {}]
    $supplier pushEvent [event tcl.pulled tcl \x2a]
    set value [$pulled pull]
    check {[lindex $value 0 1] eq "IDL:RoboCorba/Event:1.0" && [get [lindex $value 1] payload] eq "\x2a"}
    check {[get [$pulled state] kind] eq "PULL_SUPPLIER" && [get [$pulled state] events delivered] == 1}
    $pulled disconnect_pull_supplier
}

subject floors_as_events {
    set ours [Consumer #auto]
    set proxy [$channel subscribe {} [serve $ours] [clauses typed.floor_changed] $queue]
    check {[$database publishTypedChanges L1] > 0.0}
    until {[$ours cget -runs] ne {}}
    set update [$codec decode [lindex [get [lindex [$ours cget -runs] 0] payloads] 0]]
    check {[lindex $update 0] eq [corba::type of RoboCorba::TypedFloorUpdate]}
    check {[names [get [lindex $update 1] came] name] eq [lsort [list $robot_name]]}
    $proxy disconnect_push_supplier
}

# ---- a robot and its missions ----

set agent [resolve Robots/$robot_name]
set pool [$agent pool]
set control [resolve MissionControl]

proc condition {} {
    return [get [$::agent state] condition]
}

subject robot_agent {
    check {[$agent name] eq $robot_name && [$agent channel] eq $channel_name && [$agent mission] eq {}}
    answer robot_release $agent release
    answer adaptors $agent adaptors
    refused IllegalOrder {order resume} {$agent resume}
    set bad {{"name": "x", "icons": [{"icon": "wait", "seconds": -1}]}}
    answer check_program $agent checkProgram $bad
    refused InvalidProgram {icon {icons[0]} parameter seconds} {$agent loadProgram $bad}
    $agent loadProgram {{"name": "Küche", "icons": [
        {"icon": "mbase_path", "floor": "L1", "x": 5.0, "y": 5.0}, {"icon": "mbase_by", "ahead": -0.1}]}}
    answer program $agent program
    check {[string match {program * robot * map * version *} [$agent fingerprint [$agent program]]]}
    refused InvalidProgram {icon {icons[0]} parameter seconds} {$agent fingerprint $bad}
    refused IllegalOrder {order {keep an upload}} {$agent upload [$agent program] {}}
    check {[$agent reports {}] eq {reports {} next {}}}
    $agent setSpeedCap 0.5
    check {[get [$agent state] speedCap] == 0.5}
    refused InvalidSetting {field speed} {$agent setSpeedCap 100.0}
    $agent run 0
    refused IllegalOrder {order {run a program}} {$agent run 0}
    until {[$agent path] ne {}}
    check {[get [lindex [$agent path] end] position] eq {floor L1 x 5.0 y 5.0}}
    $agent pause
    until {[condition] eq "PAUSED"}
    check {[get [$agent display] kind] eq "DISPLAY_WAITING" && [string match paused* [get [$agent display] text]]}
    $agent resume
    until {[get [$agent state] program result] eq "DONE"}
    set state [$agent state]
    check {abs([get $state at x] - 4.9) < 0.05 && [get $state program name] eq "Küche"}
    check {[get $state program iconsDone] == 2 && [llength [get $state actor joints]] == 18}
    check {[names [$agent iconsFrom 1] kind] eq "mbase_by"}

    $agent run 1
    until {[condition] eq "PAUSED"}
    $agent step
    $agent abort
    until {[get [$agent state] program result] eq "ABORTED"}
    $agent loadProgram {{"name": "a", "icons": [{"icon": "confirm", "question": "hand is free?", "seconds": 60}]}}
    refused IllegalOrder {order answer condition {asks nothing}} {$agent answer 1 1}
    $agent run 0
    until {[get [$agent question] text] eq "hand is free?"}
    check {[get [$agent display] text] eq "waiting for an answer: hand is free?"}
    $agent answer [get [$agent question] number] 1
    until {[get [$agent state] program result] eq "DONE"}
    $agent drive {ahead 0.1 left 0.0 turn 0.0} 0.5
    refused InvalidSetting {field validFor} {$agent drive {ahead 0.1 left 0.0 turn 0.0} 9.0}
    until {[condition] eq "IDLE"}
    $agent stop
    check {[condition] eq "STOPPED" && [get [$agent state] reason] eq "emergency stop"}
    refused IllegalOrder {order move condition {is stopped: emergency stop}} {$agent run 0}
    $agent resetStop
    check {[condition] eq "IDLE"}
    refused UnknownAdaptor {name hovering known {corba ros2 simulated smartpal}} {$agent switchAdaptor hovering {}}
    refused AdaptorFailed {} {$agent switchAdaptor corba {}}
    $agent switchAdaptor simulated {}
    check {[get [$agent state] adaptor] eq "simulated"}
}

subject robot_links {
    set links [get [$agent linkPoses] links]
    check {[get [lindex $links 0] link] eq "base" && abs([get [lindex $links 0] x] - [get [$agent state] at x]) < 0.05}
}

subject robot_sensors {
    set sensors [$agent sensors]
    check {[names [$sensors rangeSensors] name] eq {laser proximity}}
    check {[llength [get [$sensors ranges laser] distances]] == 181}
    refused UnknownSensor {name sonar known {laser proximity}} {$sensors ranges sonar}
    check {[names [$sensors readings] name] eq "bumper"}
}

# A robot without arms that follows each command.
itcl::class Adaptor {
    inherit PortableServer::ServantBase
    public variable started 0
    private variable x
    private variable y
    private variable heading
    private variable moving {ahead 0.0 left 0.0 turn 0.0}
    private variable time 0

    constructor {at} {
        lassign [list [dict get $at x] [dict get $at y] [dict get $at heading]] x y heading
    }

    public method _Interface {} {return ::RoboCorba::RobotAdaptor}

    public method start {argv} {
        served RoboCorba::RobotAdaptor start
        set time [now]
        set started 1
    }

    public method stop {} {
        served RoboCorba::RobotAdaptor stop
        set started 0
        return 1
    }

    public method read {state} {
        upvar $state found
        served RoboCorba::RobotAdaptor read
        set passed [expr {[now] - $time}]
        set time [now]
        set x [expr {$x + $passed * [dict get $moving ahead] * cos($heading)}]
        set y [expr {$y + $passed * [dict get $moving ahead] * sin($heading)}]
        set found [list time $time x $x y $y heading $heading moving $moving joints {} jointVelocities {}]
        return $started
    }

    public method write {command} {
        served RoboCorba::RobotAdaptor write
        set moving [dict get $command wanted]
        return $started
    }

    private method now {} {return [expr {[clock microseconds] / 1e6}]}
}

subject adaptor {
    set at [get [$agent state] at]
    set ours [Adaptor #auto $at]
    $agent switchAdaptor corba [list --uri [corba::object_to_string [serve $ours]] -- more]
    check {[$ours cget -started] && [get [$agent state] adaptor] eq "corba" && [$agent sensors] == 0}
    until {[get [$agent state] actor joints] eq {}}
    until {[$agent drive {ahead -0.2 left 0.0 turn 0.0} 0.5] eq {} && [get [$agent state] at x] < [get $at x] - 0.1}
    until {[condition] eq "IDLE"}
    $agent switchAdaptor simulated {}
    until {![$ours cget -started]}
}

subject data_pool {
    check {[$pool floorName] eq "L1" && [$pool lag] >= 0.0}
    set content [$pool content]
    check {$robot_name in [names [get $content came] name] && [string length [get $content motions]] % 40 == 0}
    check {[get [$pool changes [get $content current]] since] == [get $content current]}
    until {$robot_name in [names [$pool postures 0.0] robot]}
    check {[$pool plans] eq {}}
    refused UnknownPlan {name none} {$pool plan none}
}

proc phase {} {
    set found [lsearch -inline -index 1 [$::supervisor processes] robot_V]
    return [expr {$found eq {} ? {} : [get $found phase]}]
}

subject supervisor {
    set supervisor [corba::string_to_object file://$folder/supervisor.ior]
    answer supervisor_release $supervisor release
    set order {name V adaptor simulated adaptorArguments {} onFloor L1 isPlaced 1 x 7.0 y 7.0 heading 0.0 channel main}
    check {"simulation" in [names [$supervisor processes] name]}
    $supervisor startRobot $order
    refused ProcessExists {} {$supervisor startRobot $order}
    until {[phase] eq "PROCESS_READY"}
    check {[[resolve Robots/V] name] eq "V" && [string match *robot* [$supervisor logLines robot_V 100]]}
    refused UnknownProcess {name W} {$supervisor endRobot W}
    dict set order name {a b}
    refused InvalidSetting {field name} {$supervisor startRobot $order}
}

subject missions {
    $editor create L1 {OBJECT_ELEMENT {name desk footprint {BOX_SHAPE {x 1.0 y 0.8}} at {x 7.0 y 3.0} heading 0.0
        height 0.7 movable 1}}
    until {"desk" in [names [get [$pool content] came] name]}
    set icon {{"icon": "move_table", "table": "desk", "to": {"floor": "L1", "x": 4.0, "y": 3.0}}}
    refused NoLeader {} {$control start nobody $icon}
    refused InvalidProgram {} {$control start $robot_name {{"icon": "move_table"}}}
    set name [$control start $robot_name $icon]
    set state [$control mission $name]
    check {[get $state kind] eq "move_table" && [get $state about] eq "desk" && [get $state leader] eq $robot_name}
    check {$name in [names [$control missionsSince 0] name]}
    until {[$agent mission] eq $name}
    check {[names [$control leaders $name] robot] eq $robot_name}
    until {[$pool plans] ne {}}
    check {[get [$pool plan $name.1] name] eq "$name.1" && [names [$pool plans] name] eq "$name.1"}
    $control abort $name
    until {[get [$control mission $name] result] eq "MISSION_ABORTED"}
    check {[string match "\{*" [$control report $name]]}
    answer missions $control missionsSince 0
    answer leaders $control leaders $name
    refused UnknownMission {name none} {$control report none}
    refused NoLeader {} {$control abort $name}

    until {[condition] eq "IDLE"}
    $agent startMission tcl-mission $icon
    until {[$agent mission] eq "tcl-mission"}
    $agent abortMission tcl-mission
    until {[condition] eq "IDLE"}
    refused UnknownMission {name none} {$agent abortMission none}
    $agent leadMission tcl-late $icon 7; # nobody offers it: its program fails
    until {[condition] eq "IDLE"}
    answer control_release $control release
    $supervisor endRobot V
    until {[phase] in {{} PROCESS_ENDED}}
    set desk [element OBJECT_ELEMENT L1 desk]
    $editor remove $desk [get [$editor read $desk] changedAt]
}

exit
