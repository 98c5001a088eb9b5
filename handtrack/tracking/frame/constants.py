"""Numbers of tracking that were settings and that nobody had to set, each with its unit and where it comes from."""

from __future__ import annotations

EDGE_SEARCH_PX = (16.0, 8.0, 4.0)
"""[px] how far to either side of the predicted outline edges are looked for, stage after stage: a finger's breadth in a VGA
image, then halved (docs/explanation/silhouettes.md)"""
TEXTURE_SMOOTH_PX = (4.0, 2.0, 1.0)
"""[px] by how much images are smoothed, stage after stage: coarse to fine as in the 2003 paper, section 2"""
TEXTURE_CORRELATION_PX = 6.0
"""[px] over how much of the image a texture's error stays the same; chosen by hand"""

CLOUD_PATCH_MM = 20.0
"""[mm] over how much of a mean adult's surface a cloud's error stays the same: the breadth of a finger, since a hand's own shape is
most of it and a sensor's noise the least"""

SEARCH_EVERY = 16
"""[frames] after which lost fingers are looked for however well a frame fits, since a finger hidden in a fist may settle
wrongly (docs/explanation/accuracy.md, recordings of other hands)"""
FRAMES_AHEAD = 2 * SEARCH_EVERY
"""[frames] solved at most beyond one whose search beside is not done; with half as many the first frames' searches, three in a
row, halt two cores (`bench frame_p99_vs_median`: 4 to 8, and 1.4 so)"""

FOREARM_VISIBLE_MM = 100.0
"""[mm] from the wrist, or to where the mask ends, up to which the forearm is looked at: beyond that there may be a sleeve"""

POINTS_LAST = 0.8
"""correlation of a detector's errors from frame to frame; measured 0.82 with MediaPipe's at 30 frames a second, 0.5 after four frames
(desk_two_view, what is left over after offsets)"""

BODY_BY_HAND = 9.2
"""1750 mm of a person by 190 mm of a hand: the same share of both"""

DOUBTFUL_OVERLAP = 0.65
"""a frame is doubtful if model and mask overlap less in its worst camera (intersection over union); chosen by hand"""
LOST_OVERLAP = 0.45
"""a frame is lost if they overlap less in the middle one of its cameras (median); chosen by hand"""
DOUBTFUL_PART = 0.5
"""a frame in which less of two neighbouring bones lies inside a silhouette is doubtful (docs/explanation/accuracy.md, a body)"""
DOUBTFUL_PIECE_MM2 = 500.0
"""a frame without others to compare with is doubtful where so large a piece of a silhouette lies beside the model: the two end
segments of a finger. Measured on tracked frames of two recordings of another hand (every fourth frame): at most 316; with the thumb moved
by 55 to 88 mm 1028 and more in 95 %, with an extended index finger by 30 to 98 mm 819"""
DOUBTFUL_CLOUD = 0.7
"""a frame with a smaller share of its points within 6 mm of the surface is doubtful; chosen by hand"""
LOST_CLOUD = 0.35
"""a frame with a smaller share than this is lost; chosen by hand, half of the other"""

JUMP_SHARE = 0.1
"""how probable it is that a hypothesis jumps between two frames (docs/how-to/one_camera.md); chosen by hand"""
MIXTURE_DESCENTS = 12
"""samples a frame that are optimised, where it is not by keypoints alone: then all are; chosen for time alone"""
MERGE_DEG = 2.0
"""[°] two minima closer than this, root mean square over all angles, are one"""
APART_MM = 40.0
"""[mm] by which hypotheses that are shown differ at least, mean over the joints relative to the root"""
