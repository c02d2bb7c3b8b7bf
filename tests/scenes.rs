//! Synthetic scenes through the daemon and through `lookout evaluate weather`.

use crate::support::{self, Bench, document, files, lines};

#[test]
fn a_scene_goes_through_the_daemon_as_it_does_in_one_process() {
    let bench = Bench::new();
    let scene = "scene:car-rear?weather=light_rain";
    bench.ok(&["replay", scene, "--lockstep", "--limit", "8", "--out", "a"]);
    bench.ok(&["replay", scene, "--in-process", "--limit", "8", "--out", "b"]);
    bench.assert_clean();
    assert!(files(&bench.path("a")) == files(&bench.path("b")));
    assert_eq!(lines(&bench.path("a")).len(), 8);
    // A user's scene, which ends by itself.
    std::fs::write(
        bench.path("mine.toml"),
        "title = \"An empty road\"\nseconds = 0.4\n[ego]\nspeed_m_s = 5\n[[beside]]\nkind = \"trees\"\nlateral_m = 8\nto_m = 80\n",
    )
    .unwrap();
    bench.ok(&["replay", "scene:mine.toml", "--in-process", "--out", "c"]);
    assert_eq!(lines(&bench.path("c")).len(), 5);
}

#[test]
fn an_unknown_scene_is_named_with_the_remedy() {
    let bench = Bench::new();
    let text = bench.fails(&["replay", "scene:sreet", "--in-process"]);
    assert!(text.contains("sreet: no such scene") && text.contains("street"), "{text}");
    let text = bench.fails(&["replay", "scene:street?weather=hail", "--in-process"]);
    assert!(text.contains("weather=hail") && text.contains("heavy_rain"), "{text}");
    std::fs::write(bench.path("bad.toml"), "title = \"x\"\nseconds = 1\n\n[ego]\nspeed_m_s = \"fast\"\n")
        .unwrap();
    for args in [
        &["replay", "scene:bad.toml", "--in-process"][..],
        &["replay", "scene:bad.toml"],
        &["evaluate", "weather", "bad.toml"],
        &["evaluate", "distance", "bad.toml"],
    ] {
        let text = bench.fails(args);
        assert!(text.contains("bad.toml:5: ") && text.contains("\"fast\""), "{args:?}: {text}");
    }
    let text = bench.run(&["evaluate", "weather", "--weather", "hail"]);
    assert_eq!(text.status.code(), Some(2));
}

#[test]
fn a_single_road_plane_mistakes_a_dip_for_obstacles() {
    let bench = Bench::new();
    let args = ["evaluate", "weather", "dip-traffic", "--weather", "sunny", "--frames", "30", "--ablation"];
    let report = document(&bench, &[&args[..], &["--json", "--out", "out"]].concat());
    let rows = report["rows"].as_array().unwrap();
    let roads: Vec<&str> = rows.iter().map(|row| row["road"].as_str().unwrap()).collect();
    assert_eq!(roads, ["profile", "plane"]);
    let false_regions = |row: usize| rows[row]["false_per_minute"].as_f64().unwrap();
    assert!(false_regions(1) > 300.0 + 3.0 * false_regions(0), "{report}");
    assert!(bench.path("out/dip-traffic-sunny-plane.png").is_file());
}

#[test]
fn weather_is_scored_against_the_truth() {
    let bench = Bench::new();
    let args = ["evaluate", "weather", "car-rear", "--weather", "sunny,night", "--frames", "12"];
    let report = document(&bench, &[&args[..], &["--json", "--out", "out"]].concat());
    let rows = report["rows"].as_array().unwrap();
    let names: Vec<&str> = rows.iter().map(|row| row["weather"].as_str().unwrap()).collect();
    assert_eq!(names, ["sunny", "night"]);
    assert_eq!((&rows[0]["paper_rate"], &rows[1]["paper_rate"]), (&0.905.into(), &0.806.into()));
    for row in rows {
        // One car, 30 to 25 m away, in every frame.
        assert_eq!((&row["frames"], &row["due"], &row["road_seen"]), (&12.into(), &12.into(), &12.into()));
        let range = &row["ranges"][4];
        assert_eq!((&range["from_m"], &range["due"]), (&27.5.into(), &7.into()));
        assert!(row["road_median_m"].as_f64().unwrap() < 0.2, "{row}");
    }
    assert!(rows[0]["detection_rate"].as_f64().unwrap() > 0.8, "{}", rows[0]);
    assert!(rows[0]["all"]["median_percent"].as_f64().unwrap() < 8.0, "{}", rows[0]);
    for file in ["car-rear-sunny.png", "car-rear-night.png", "evaluation.json"] {
        assert!(bench.path("out").join(file).is_file(), "{file}");
    }
    // The same again, and as a table.
    assert_eq!(report, document(&bench, &[&args[..], &["--json"]].concat()));
    let table = bench.ok(&args);
    assert!(
        table.contains("car-rear night") && table.contains("0.806") && table.contains("27.5 to 40 m"),
        "{table}"
    );
}

#[test]
fn an_alarm_that_cannot_decide_is_off_and_says_why() {
    let bench = Bench::new();
    bench.ok(&["replay", "scene:textureless", "--in-process", "--limit", "10", "--out", "a"]);
    let lines = lines(&bench.path("a"));
    let alarm = &lines[9]["alarm"];
    assert_eq!(
        (&alarm["level"], &alarm["reason"]),
        (&"off".into(), &"too little texture on the road".into())
    );
    bench.ok(&[
        "replay",
        "scene:textureless",
        "--in-process",
        "--limit",
        "10",
        "--out",
        "b",
        "--set",
        "alarm.self_check=false",
    ]);
    assert_eq!(support::lines(&bench.path("b"))[9]["alarm"]["level"], "clear");
}

#[test]
fn generated_scenes_are_scored_by_seed() {
    let bench = Bench::new();
    let args = ["evaluate", "weather", "random", "--seeds", "4-5", "--weather", "sunny", "--frames", "6"];
    let report = document(&bench, &[&args[..], &["--json", "--out", "out", "--threads", "2"]].concat());
    let row = &report["rows"][0];
    assert_eq!((&row["scene"], &row["frames"]), (&"random 4-5".into(), &12.into()));
    assert!(bench.path("out/random-4-5-sunny.png").is_file());
    // By the strict rule never more objects are found, and each that is found has at least one box.
    let value = |of: &str, key: &str| row[of][key].as_f64().unwrap_or_else(|| panic!("{of}.{key}: {row}"));
    for of in ["regions", "obstacles"] {
        assert!(value(of, "strict_rate") <= value(of, "detection_rate"), "{row}");
        assert!(value(of, "boxes_per_object") >= 1.0, "{row}");
    }
    assert_eq!(value("regions", "detection_rate"), row["detection_rate"].as_f64().unwrap());
    assert!(row["due"].as_u64().unwrap() >= 6 && row["false_alarms"].as_f64().is_some(), "{row}");
    // Threads change nothing.
    assert_eq!(report, document(&bench, &[&args[..], &["--json"]].concat()));
    let wrong = bench.run(&["evaluate", "weather", "random", "--seeds", "9-3"]);
    assert_eq!(wrong.status.code(), Some(2));
}

#[test]
fn a_generated_scene_is_also_a_file() {
    let bench = Bench::new();
    let text = bench.ok(&["scene", "random?seed=9"]);
    std::fs::write(bench.path("nine.toml"), text).unwrap();
    bench.ok(&["replay", "scene:random?seed=9", "--in-process", "--limit", "2", "--out", "a"]);
    bench.ok(&["replay", "scene:nine.toml", "--in-process", "--limit", "2", "--out", "b"]);
    assert!(files(&bench.path("a")) == files(&bench.path("b")));
    let told = bench.fails(&["scene", "random?seed=9&weather=snow"]);
    assert!(told.contains("weather=snow is not part of the text"), "{told}");
}
