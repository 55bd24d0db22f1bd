"""Loops of users in compiled code, around the functions of a simulator."""
