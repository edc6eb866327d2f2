"""The supervisor in CORBA: conversion, servant, client."""
