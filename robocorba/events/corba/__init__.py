"""Event channels in CORBA: conversion, servants, clients."""

import omniORB  # noqa: F401  Python finds CosEventComm and its like only then.
