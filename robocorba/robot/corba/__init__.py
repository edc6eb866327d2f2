"""Robots in CORBA: conversion, servants, clients."""
