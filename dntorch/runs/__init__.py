"""Runs of one agent: trained, recorded, resumed, drawn, filmed, swept, driven on a robot."""
