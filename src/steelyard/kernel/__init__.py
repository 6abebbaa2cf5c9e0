"""Equations written once over symbols, traced per robot, run by backends."""
