"""The path planning agent in CORBA: conversion, servant, client."""
