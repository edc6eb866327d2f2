"""Path planning agent domain: from a building and a request to a path. No CORBA here."""
