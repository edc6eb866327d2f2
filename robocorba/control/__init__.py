"""The control agent: runs the same program on a virtual or an actual robot through an adaptor."""
