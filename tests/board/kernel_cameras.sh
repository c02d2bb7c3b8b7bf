# Two cameras of the kernel, by its driver vivid: read by cameras.sh and tutorial.sh. Needs root, the module vivid, and
# v4l2-ctl (package v4l-utils).
#
# Each camera's output node takes frames, and its capture node gives them again, byte for byte, while both have one pixel
# format and the timings of the same signal.

players=''
# The node of a device: left or right, cap or out.
node() {
  local number=0 entry
  [ "$1" = left ] || number=1
  for entry in /sys/class/video4linux/video*; do
    [ "$(cat "$entry/name")" != "vivid-00$number-vid-$2" ] || { echo "/dev/${entry##*/}"; return; }
  done
  echo "no node vivid-00$number-vid-$2" >&2
  return 1
}
# Cameras with a loop from output to capture, 640x480 at 60 frames/s: the slowest signal of the driver.
loop_cameras() {
  stop_playing
  modprobe -r vivid
  modprobe vivid n_devs=2 node_types=0x101,0x101 num_inputs=1,1 input_types=0x3,0x3 num_outputs=1,1 output_types=0x1,0x1
  udevadm settle
  local side
  for side in left right; do
    v4l2-ctl -d "$(node $side out)" --set-dv-bt-timings index=0 >/dev/null
    v4l2-ctl -d "$(node $side cap)" --set-dv-bt-timings index=0 >/dev/null
    v4l2-ctl -d "$(node $side cap)" -c loop_video=1 -c osd_text_mode=2
  done
}
# Cameras with a test pattern, as USB cameras have sizes and rates.
pattern_cameras() {
  stop_playing
  modprobe -r vivid
  modprobe vivid n_devs=2 node_types=0x1,0x1 num_inputs=1,1 input_types=0x0,0x0
  udevadm settle
}
# Plays a frame again and again: of both cameras, so that neither shows an old one meanwhile.
play() { # FORMAT LEFT RIGHT
  stop_playing
  local side file
  for side in left right; do
    [ $side = left ] && file=$2 || file=$3
    v4l2-ctl -d "$(node $side out)" --set-fmt-video-out="width=640,height=480,pixelformat=$1" >/dev/null
    v4l2-ctl -d "$(node $side out)" --stream-out-mmap=4 --stream-loop --stream-from="$file" >/dev/null 2>&1 &
    players="$players $!"
  done
}
stop_playing() {
  [ -z "$players" ] || { kill $players; wait $players; } 2>/dev/null || true
  players=''
}
