"""The operator's console: the paper's windows as pages of a web browser. A CORBA client like any other."""
