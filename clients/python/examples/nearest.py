"""Prints the nearest obstacle in the path of each frame: nearest.py [INSTANCE [DIRECTORY [FRAMES]]]"""

import sys

import lookout

instance, directory, frames = [*sys.argv[1:], None, None, None][:3]
client = lookout.Client(instance, directory, pictures=True)
for number, frame in enumerate(client, start=1):
    known = 0 if frame.disparity is None else (frame.disparity > 0).sum()
    for obstacle in frame.obstacles[frame.obstacles["track"] == frame.alarm["object"]]:
        print(f"{frame.sequence} {frame.level} {obstacle['distance_m']:.1f} m, {known} disparities", flush=True)
    if number == int(frames or 0):
        break
