"""The map editor in CORBA: conversion, servants, clients."""
