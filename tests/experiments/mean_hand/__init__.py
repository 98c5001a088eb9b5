"""hand26's mean hand: fitted to people's meshes and measurements (`mean`), judged by hands that are left out (`left_out`).

Nothing of the meshes is kept here: they are read from copies that the caller names. MakeHuman's meshes are CC0; WebXR's generic hand (MIT)
and UmeTrack's (CC BY-NC) are only tracked, never in the mean.
"""
