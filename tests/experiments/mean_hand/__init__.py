"""hand26's mean hand: fitted to people's meshes and measurements (`mean`), judged by hands that are left out (`recordings`, `judge`,
`minima`).

Nothing of the meshes is kept here: they are read from copies that the caller names. WebXR's generic hand is MIT, MakeHuman's meshes are
CC0; UmeTrack's hand (CC BY-NC) is only tracked, never in the mean.
"""
