"""RT components in CORBA: conversion, servants, clients."""
