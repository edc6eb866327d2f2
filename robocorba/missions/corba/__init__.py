"""Missions in CORBA: conversion, servants, clients."""
