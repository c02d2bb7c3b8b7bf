//! Mistakes in a configuration.

use super::{check, write};
use crate::support::Bench;

/// Cameras of OpenCV without the size of their pictures.
const OPENCV: &str = "M1: [440, 0, 160, 0, 440, 110, 0, 0, 1]\nD1: [0, 0, 0, 0, 0]\n\
                      M2: [440, 0, 160, 0, 440, 110, 0, 0, 1]\nD2: [0, 0, 0, 0, 0]\n\
                      R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nT: [-0.12, 0, 0]\n";

#[test]
fn mistakes_in_a_configuration_have_file_line_and_remedy() {
    let bench = Bench::new();
    bench.record("drive", 1);
    for (name, content) in [
        ("key.toml", "[alarm]\ndistence_m = 10\n"),
        ("table.toml", "\n[alarms]\n"),
        ("other_table.toml", "[steroe]\ndisparities = 64\n"),
        ("range.toml", "[alarm]\ndistance_m = 10000\n"),
        ("type.toml", "[alarm]\ndistance_m = \"10 m\"\n"),
        ("choice.toml", "[source]\nkind = \"camara\"\n"),
        ("syntax.toml", "[alarm\n"),
        ("twice.toml", "[alarm]\nhold_ms = 1\nhold_ms = 2\n"),
        ("profile.toml", "profile = \"pi\"\n"),
        ("no_path.toml", "[source]\nkind = \"folder\"\n"),
        ("path.toml", "[source]\nkind = \"folder\"\npath = \"gone\"\n"),
        ("rig.toml", "[source]\nrig = \"gone.toml\"\n"),
        ("cascade.toml", "\n[recognition]\ncascade = \"gone.xml\"\n"),
        ("motion.toml", "\n[vehicle]\nmotion = \"gone.csv\"\n"),
        ("dbc.toml", "[vehicle]\nbus = \"can0\"\n\ndbc = \"gone.dbc\"\n"),
        (
            "patterns.toml",
            "[source]\nkind = \"folder\"\nleft = \"drive/left/*.png\"\nright = \"gone/*.png\"\n",
        ),
        ("scene.toml", "[source]\npath = \"gone.toml\"\n"),
        (
            "two.toml",
            "[source]\nkind = \"folder\"\npath = \"gone\"\nrig = \"gone.toml\"\n[vehicle]\nmotion = \"gone.csv\"\n",
        ),
        (
            "camera.toml",
            "[source]\nkind = \"camera\"\n[camera]\nleft = \"/dev/video97\"\nright = \"/dev/video98\"\n",
        ),
        ("one.toml", "[source]\nkind = \"folder\"\nleft = \"drive/left\"\n"),
        ("no_pairs.toml", "[source]\nkind = \"folder\"\n\npath = \"nothing\"\n"),
        ("nothing/notes.txt", ""),
        ("no_recording.toml", "[source]\nkind = \"recording\"\npath = \"key.toml\"\n"),
        ("other_size.toml", "[source]\nkind = \"folder\"\npath = \"drive\"\nrig = \"wide.toml\"\n"),
        (
            "wide.toml",
            "focal_px = 440\nbaseline_m = 0.12\ncx_px = 640\ncy_px = 360\nwidth = 1280\nheight = 720\n",
        ),
        ("half_size.toml", "[source]\nkind = \"folder\"\npath = \"drive\"\nrig = \"half.rig.toml\"\n"),
        ("half.rig.toml", "focal_px = 440\nbaseline_m = 0.12\ncx_px = 80\ncy_px = 60\n"),
        ("camera_size.toml", "[source]\nkind = \"camera\"\nrig = \"wide.toml\"\n"),
        ("tls.toml", "[bridge]\n\ntls_ca = \"gone.pem\"\ntls_key = \"gone.key\"\n"),
        (
            "one_camera.toml",
            "[source]\nkind = \"camera\"\n[camera]\nleft = \"/dev/video7\"\nright = \"/dev/video7\"\n",
        ),
        ("left_only.toml", "[source]\nkind = \"camera\"\n[camera]\nleft = \"/dev/video2\"\n"),
        ("camera_half.toml", "[source]\nkind = \"camera\"\nrig = \"half.rig.toml\"\n"),
        ("camera_outside.toml", "[source]\nkind = \"camera\"\nrig = \"outside.rig.toml\"\n"),
        ("outside.rig.toml", "focal_px = 440\nbaseline_m = 0.12\ncx_px = 960\ncy_px = 540\n"),
        ("camera_rectify.toml", "[source]\nkind = \"camera\"\nrig = \"middle.rig.toml\"\nrectify = true\n"),
        ("middle.rig.toml", "focal_px = 440\nbaseline_m = 0.12\ncx_px = 320\ncy_px = 240\n"),
        ("opencv.toml", "[source]\nkind = \"folder\"\npath = \"drive\"\nrig = \"opencv.yml\"\n"),
        ("opencv.yml", OPENCV),
        ("videos.toml", "[source]\nkind = \"recording\"\nleft = \"gone.mp4\"\nright = \"gone_too.mp4\"\n"),
        (
            "detectors.toml",
            "[recognition]\nnetwork = \"gone.onnx\"\ncascade = \"gone.xml\"\n[[recognition.detectors]]\nkind = \"hog\"\nmodel = \"gone.hog\"\n",
        ),
        ("people.toml", "[recognition]\ncascade = \"people\"\n"),
        ("bits.toml", "[source]\nbits = 11\n"),
        ("bayer.toml", "[source]\nbayer = \"rgbg\"\n"),
        ("crossed.toml", "[road]\ncamera_height_min_m = 3\ncamera_height_max_m = 2\n"),
    ] {
        write(&bench, name, content);
    }
    check(
        &bench,
        &[
            ("check-config", 2, &["<FILE>"]),
            ("check-config gone.toml", 1, &["gone.toml", "profiles", "rpi5"]),
            (
                "check-config key.toml",
                1,
                &["key.toml:2", "alarm.distence_m", "did you mean alarm.distance_m?"],
            ),
            ("check-config table.toml", 1, &["table.toml:2", "[alarms]", "did you mean alarm?"]),
            ("check-config other_table.toml", 1, &["other_table.toml:1", "did you mean stereo?"]),
            ("check-config range.toml", 1, &["range.toml:2", "alarm.distance_m = 10000", "from 0.5 to 200"]),
            ("check-config type.toml", 1, &["type.toml:2", "give a number"]),
            ("check-config choice.toml", 1, &["choice.toml:2", "source.kind", "\"camera\""]),
            ("check-config syntax.toml", 1, &["syntax.toml:1"]),
            ("check-config twice.toml", 1, &["twice.toml:3", "duplicate", "keep one"]),
            ("check-config profile.toml", 1, &["profile.toml:1", "rpi5"]),
            (
                "check-config rig.toml",
                1,
                &["rig.toml:2: source.rig", "gone.toml", "no such file", "lookout calibrate"],
            ),
            ("check-config cascade.toml", 1, &["cascade.toml:3: recognition.cascade", "gone.xml", "vehicle"]),
            ("check-config path.toml", 1, &["path.toml:3: source.path", "gone", "no such file or folder"]),
            ("check-config motion.toml", 1, &["motion.toml:3: vehicle.motion", "gone.csv", "no such file"]),
            ("check-config dbc.toml", 1, &["dbc.toml:4: vehicle.dbc", "gone.dbc", "give"]),
            (
                "check-config patterns.toml",
                1,
                &["patterns.toml:4: source.right", "gone/*.png", "matches no picture"],
            ),
            ("check-config scene.toml", 1, &["scene.toml:2: source.path", "gone.toml", "give a TOML file"]),
            (
                "check-config two.toml",
                1,
                &["two.toml:3: source.path", "two.toml:4: source.rig", "two.toml:6: vehicle.motion"],
            ),
            (
                "check-config camera.toml",
                0,
                &[
                    "camera.toml:4: camera.left",
                    "/dev/video97",
                    "camera.toml:5: camera.right",
                    "on this machine",
                ],
            ),
            (
                "check-config no_pairs.toml",
                1,
                &["no_pairs.toml:4: source.path", "nothing", "notes.txt", "left and right"],
            ),
            ("check-config no_recording.toml", 1, &["no_recording.toml:3: source.path", "a TOML file", "-c"]),
            (
                "check-config other_size.toml",
                1,
                &["other_size.toml:4: source.rig", "1280x720", "320x240", "calibrate at"],
            ),
            ("check-config half_size.toml", 0, &["half.rig.toml", "far from the middle", "source.rig"]),
            ("check-config camera_size.toml", 1, &["camera_size.toml:3: source.rig", "1280x720", "640x480"]),
            (
                "check-config tls.toml",
                1,
                &["tls.toml:3: bridge.tls_ca", "gone.pem", "tls.toml:4: bridge.tls_key", "(PEM)"],
            ),
            (
                "check-config one_camera.toml",
                1,
                &["one_camera.toml:5: camera.left", "camera.right", "are one device", "side_by_side"],
            ),
            ("check-config left_only.toml", 1, &["left_only.toml:4: camera.left", "are one device"]),
            ("run -c one_camera.toml", 1, &["are one device", "side_by_side"]),
            // What options replace or complete is no mistake of the file.
            ("replay drive --in-process -c one_camera.toml", 0, &[]),
            (
                "run -c one_camera.toml --set camera.side_by_side=true",
                1,
                &["source.rig is empty", "lookout calibrate --live camera"],
            ),
            (
                "check-config camera_half.toml",
                0,
                &["half.rig.toml", "far from the middle", "640x480", "source.rig"],
            ),
            (
                "check-config camera_outside.toml",
                1,
                &["camera_outside.toml:3: ", "outside.rig.toml", "640x480", "another size"],
            ),
            (
                "check-config camera_rectify.toml",
                1,
                &["camera_rectify.toml:4: source.rectify is true", "describes rectified pictures"],
            ),
            ("check-config opencv.toml", 0, &[]),
            ("check-config videos.toml", 1, &["videos.toml:3: source.left", "gone.mp4", "no such file"]),
            (
                "check-config detectors.toml",
                1,
                &[
                    "detectors.toml:2: recognition.network",
                    "gone.onnx",
                    "objects for the network that ships",
                    "detectors.toml:3: recognition.cascade",
                    "gone.xml",
                    "recognition.detectors",
                    "gone.hog",
                    "people",
                ],
            ),
            (
                "check-config people.toml",
                1,
                &["people.toml:2", "a HOG model, no cascade", "[[recognition.detectors]]"],
            ),
            ("check-config bits.toml", 1, &["bits.toml:2: source.bits = 11", "\"12\""]),
            ("check-config drive/left/000000.png", 1, &["000000.png", "not a text", "lookout init"]),
            ("doctor -c camera.toml", 1, &["problems", "say what to do"]),
            ("doctor -c gone.toml", 1, &["gone.toml", "profiles"]),
            ("doctor --jsn", 2, &["--jsn", "--json"]),
            ("run -c camera.toml", 1, &["source.rig is empty", "lookout calibrate --live camera"]),
            ("check-config bayer.toml", 1, &["bayer.toml:2", "source.bayer", "\"rggb\""]),
            ("check-config crossed.toml", 1, &["crossed.toml:2", "road.camera_height_min_m", "at most 2"]),
            ("run -c no_path.toml", 1, &["source.path is empty"]),
            ("run -c one.toml", 1, &["source.left and source.right", "--right"]),
            ("replay drive -c gone.toml", 1, &["gone.toml", "give a file, or one of the profiles"]),
            (
                "replay drive --set alarm.distance=10",
                1,
                &["--set: unknown key alarm.distance", "did you mean alarm.distance_m?"],
            ),
            (
                "replay drive --set alrm.distance_m=10",
                1,
                &["--set: unknown table [alrm]", "did you mean alarm?"],
            ),
            ("replay drive --set stereo.threads=0", 1, &["--set: stereo.threads = 0", "from 1 to 64"]),
            ("replay drive --set distance_m=10", 1, &["--set distance_m=10", "TABLE.KEY=VALUE"]),
            ("replay drive --set", 2, &["--set"]),
            ("replay drive --instance 'a b'", 1, &["--instance: instance.name", "letters, digits"]),
        ],
    );
    bench.assert_clean();
}
