"""The simulation server in CORBA: conversion, servants, clients."""
