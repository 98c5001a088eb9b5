"""Recordings of hands that are not the model, with truth: other people's meshes, their tissue thicker or thinner, motions made here and
others', and what goes wrong in real ones. `python -m tests.experiments.honesty.recordings` writes them.

Nothing of the meshes and motions is kept here: they are read from copies that the caller names. MakeHuman's meshes are CC0, WebXR's generic
hand MIT, RealSense's and Leap Motion's motions Apache-2.0; UmeTrack's hand is CC BY-NC: for evaluation only.
"""
