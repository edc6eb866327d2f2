# Ask the path planning agent for a path, from Tcl with Combat:
#
#   tclsh get_path.tcl robocorba.tcl corbaname::127.0.0.1:2809#RoboCorba/PathPlanner  L1 3 4  L3 10 2
#
# robocorba.tcl has the IDL: omniidl -p idl -b tcl idl/*.idl > robocorba.tcl

package require combat
# 65537 is Latin-1: Combat sends names as UTF-8 unless that is its own code set.
set argv [corba::init -ORBNativeCodeSet 65537 {*}$argv]
if {[llength $argv] != 8} {
    puts stderr "get_path.tcl REPOSITORY URI FLOOR X Y FLOOR X Y"
    exit 2
}
lassign $argv repository uri floor1 x1 y1 floor2 x2 y2
source $repository

corba::try {
    set planner [corba::string_to_object $uri]
    foreach point [$planner getPath [list floor $floor1 x $x1 y $y1] [list floor $floor2 x $x2 y $y2]] {
        set at [dict get $point position]
        puts "[dict get $point time] s  [dict get $at floor]:[dict get $at x],[dict get $at y]  [dict get $point node]"
    }
} catch {RoboCorba::NotFree refusal} {
    puts stderr "[dict get [lindex $refusal 1] which] is too near to [dict get [lindex $refusal 1] obstacle]"
    exit 1
} catch {... failure} {
    puts stderr "the call failed: $failure"
    exit 1
}
