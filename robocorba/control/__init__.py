"""The control agent: the same program on a virtual or an actual robot, through one adaptor."""
