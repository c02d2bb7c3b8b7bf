//! The viewer: its page in a real browser against the ground truth of the scene; it changes no result.

use crate::support::browser::Browser;
use crate::support::viewer::Viewer;
use crate::support::{Bench, WATCHDOG, files, send};
use perception::region::PixelBox;
use serde_json::Value;
use sources::scene::Drive;
use std::collections::BTreeSet;

/// Frames that are compared with the ground truth.
const COMPARED: usize = 8;

/// The drive: 640 × 480, few frames a second, so that a busy machine shows them all.
const FPS: f64 = 5.0;

/// What the page shows: the picture's number, its grey levels on a coarse grid, and the boxes as they lie
/// on the screen, in pixels of the picture.
const SHOWN: &str = r#"(() => {
  const left = document.getElementById("left");
  const view = document.getElementById("boxes");
  const sequence = Number(left.dataset.sequence);
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [left.naturalWidth, left.naturalHeight];
  const c = canvas.getContext("2d");
  c.drawImage(left, 0, 0);
  const pixels = c.getImageData(0, 0, canvas.width, canvas.height).data;
  const grid = [];
  for (let y = 0; y < canvas.height; y += 16)
    for (let x = 0; x < canvas.width; x += 16) grid.push(pixels[4 * (y * canvas.width + x)]);
  const frame = left.getBoundingClientRect();
  const scale = left.naturalWidth / frame.width;
  const boxes = [...view.querySelectorAll(".box.confirmed")].map((g) => {
    const r = g.querySelector("rect").getBoundingClientRect();
    return { x: (r.left - frame.left) * scale, y: (r.top - frame.top) * scale, width: r.width * scale,
      height: r.height * scale, distance: Number(g.dataset.distance) };
  });
  const free = freeAhead(page.frame);
  return { sequence, boxes_of: Number(view.dataset.sequence), width: canvas.width, grid, boxes, free };
})()"#;

/// The bird's-eye view of synthetic free space: 35 m, and 12 m in the middle. Gives how many of ten places in the
/// middle before and behind its end, and of ten to the left, look other than with nothing free.
const FREE_DRAWN: &str = r#"(() => {
  const canvas = document.getElementById("birds");
  const columns = page.frame.free_m.length;
  const middle = (i) => Math.abs(i - columns / 2) < 10;
  const made = Array.from({ length: columns }, (_, i) => (middle(i) ? 12 : 35));
  const look = (free_m) => {
    const frame = { ...page.frame, free_m, regions: [], obstacles: [] };
    drawBirds(frame, null);
    const dots = canvas.width / canvas.clientWidth;
    const perMetre = (canvas.clientHeight - 14) / AHEAD_M;
    const pixel = ([x, z]) => canvas.getContext("2d").getImageData(
      Math.round((canvas.clientWidth / 2 + x * perMetre) * dots),
      Math.round((canvas.clientHeight - 6 - z * perMetre) * dots), 1, 1).data.join();
    const row = (x, from) => Array.from({ length: 10 }, (_, i) => pixel([x * (from + i / 2), from + i / 2]));
    return { near: row(0, 5), behind: row(0, 14), left: row(-0.2, 14), ahead: freeAhead(frame), label: canvas.ariaLabel };
  };
  const [free, none] = [look(made), look(made.map(() => 0))];
  drawBirds(page.frame, page.points);
  const changed = (name) => free[name].filter((p, i) => p !== none[name][i]).length;
  return { columns, near: changed("near"), behind: changed("behind"), left: changed("left"),
    ahead: free.ahead, label: free.label, none: none.label };
})()"#;

/// A path to the left and one that is straight because the motion is unknown: the lines over the picture, how many of ten
/// places on the left edge of the bird's-eye view change, and what the page says of the motion.
const PATH_DRAWN: &str = r#"(() => {
  const canvas = document.getElementById("birds");
  const edge = (side, bend) => Array.from({ length: 16 }, (_, i) => [side - bend * i * i, 2 + 2 * i]);
  const sigma_m = Array(16).fill(0.1);
  const bent = { known: true, left_m: edge(-1, 0.02), right_m: edge(1, 0.02), sigma_m };
  const straight = { known: false, left_m: edge(-1, 0), right_m: edge(1, 0), sigma_m };
  const none = { known: false, left_m: [], right_m: [], sigma_m: [] };
  const path_px = [[[100, 400], [150, 300], [170, 250]], [[500, 400], [400, 300]]];
  const known = { known: true, sources: ["odometry", "bus_yaw_rate"], standstill: false, disagree: true,
    speed_m_s: 9.96, speed_sigma_m_s: 0.1, yaw_rate_rad_s: 0.2, yaw_rate_sigma_rad_s: 0.01 };
  const look = (path, pixels, motion) => {
    const frame = { ...page.frame, path, path_px: pixels, motion, regions: [], obstacles: [] };
    drawBirds(frame, null);
    drawBoxes(frame);
    tellMotion(frame);
    const dots = canvas.width / canvas.clientWidth;
    const perMetre = (canvas.clientHeight - 14) / AHEAD_M;
    const pixel = ([x, z]) => canvas.getContext("2d").getImageData(
      Math.round((canvas.clientWidth / 2 + x * perMetre) * dots),
      Math.round((canvas.clientHeight - 6 - z * perMetre) * dots), 1, 1).data.join();
    const lines = [...document.querySelectorAll('#boxes .way')].map((line) => line.getAttribute("class"));
    return { on: bent.left_m.slice(2, 12).map(pixel), lines, said: document.getElementById("motion").textContent,
      caption: document.getElementById("birds-caption").textContent };
  };
  const [with_path, without] = [look(bent, path_px, known), look(none, [[], []], { known: false, sources: [] })];
  const assumed = look(straight, path_px, { known: false, sources: [] });
  drawBirds(page.frame, page.points);
  drawBoxes(page.frame);
  tellMotion(page.frame);
  return { changed: with_path.on.filter((p, i) => p !== without.on[i]).length, lines: with_path.lines,
    none: without.lines, assumed: assumed.lines, said: with_path.said, unknown: without.said,
    captions: [with_path.caption, assumed.caption] };
})()"#;

/// The texts with values of the daemon: own motion, health, captions of charts, processes.
const CURRENT: &str = r#"[...document.querySelectorAll('#motion, #health, [id^="k-"], #processes tbody td')]
  .map((element) => element.textContent).filter((text) => text && !text.startsWith("no daemon"))"#;

/// Number of labels that are drawn of many obstacles far ahead, and of those that touch another in their row.
const TOUCHING: &str = r#"(() => {
  const made = Array.from({ length: 24 }, (_, i) => ({ ...page.frame.obstacles[0], track: 1000 + i, class: "vehicle",
    confirmed: true, predicted: false, distance_m: 20 + 3.1 * i, distance_sigma_m: 1, time_to_collision_s: null,
    x_px: 40 + 23 * i, y_px: 200 + 3 * (i % 4), width_px: 20, height_px: 16 }));
  drawBoxes({ ...page.frame, obstacles: made });
  const drawn = [...document.querySelectorAll('#boxes text')].map((text) => text.getBoundingClientRect());
  drawBoxes(page.frame);
  const touches = (a, b) => Math.abs(a.top - b.top) < 5 && a.left < b.right && b.left < a.right;
  const touching = drawn.filter((a, i) => drawn.some((b, j) => j > i && touches(a, b)));
  return { drawn: drawn.filter((label) => label.width > 0).length, touching: touching.length };
})()"#;

/// The numbers that are drawn in the bird's-eye view of three tracks side by side, of which the last is the nearest, and of
/// one apart; and of the same with the farthest as cause of an alarm.
const NUMBERS: &str = r#"(() => {
  const c = document.getElementById("birds").getContext("2d");
  const at = (track, distance_m, lateral_m) => ({ ...page.frame.obstacles[0], track, distance_m, lateral_m, width_m: 0.4,
    confirmed: true, predicted: false, distance_sigma_m: 0.1, closing_m_s: null });
  const obstacles = [at(1, 20.6, 0.2), at(2, 20.4, 0.1), at(3, 20.2, 0), at(4, 30, 0)];
  const drawn = (alarm) => {
    const texts = [];
    c.fillText = (text) => texts.push(text);
    drawBirds({ ...page.frame, obstacles, alarm: { ...page.frame.alarm, ...alarm } }, null);
    delete c.fillText;
    return texts.filter((text) => !text.endsWith(" m"));
  };
  const lists = [drawn({ level: "clear", track: null }), drawn({ level: "alarm", track: 1 })];
  drawBirds(page.frame, page.points);
  return lists;
})()"#;

/// How often a picture is the one of its number, the car ahead lies in a box with its distance, and the way is
/// free as far as the car.
fn compare(browser: &mut Browser, drive: &mut Drive) -> ([usize; 3], String) {
    let (mut seen, mut same, mut boxed, mut free, mut told) = (BTreeSet::new(), 0, 0, 0, String::new());
    while seen.len() < COMPARED {
        // A paused page does not change while it is examined.
        browser.value("if (!page.is_paused) pause()");
        let shown = browser.value(SHOWN);
        browser.value("if (page.is_paused) pause()");
        let sequence = shown["sequence"].as_u64().expect("a number");
        let lead_m = Drive::lead_distance_m(drive.time_s(sequence));
        // Tracks take a few frames to be confirmed, and far cars are small.
        if sequence < 8 || !(7.0..26.0).contains(&lead_m) || !seen.insert(sequence) {
            browser.value(&format!("new Promise((go) => setTimeout(go, {}))", 500.0 / FPS));
            continue;
        }
        assert_eq!(shown["boxes_of"], sequence, "boxes of another frame than the picture's");
        let frame = drive.frame(sequence);
        let grid = shown["grid"].as_array().expect("grey levels");
        let truth: Vec<u8> = (0..480)
            .step_by(16)
            .flat_map(|y| (0..640).step_by(16).map(move |x| (x, y)))
            .map(|(x, y)| frame.left[y * 640 + x])
            .collect();
        assert_eq!((grid.len(), shown["width"].as_u64()), (truth.len(), Some(640)));
        let differences: u64 =
            grid.iter().zip(&truth).map(|(a, b)| a.as_u64().unwrap().abs_diff(u64::from(*b))).sum();
        let mean = differences as f64 / truth.len() as f64;
        same += usize::from(mean < 4.0);
        let car = frame
            .truth
            .objects
            .iter()
            .find(|o| o.in_path && o.subject && (o.distance_m - lead_m).abs() < 0.5);
        let car = car.expect("the car ahead is in sight");
        let number = |b: &Value, key: &str| b[key].as_f64().expect("a number");
        let best = shown["boxes"].as_array().expect("boxes").iter().map(|b| {
            let side = |key| number(b, key).round() as u32;
            let drawn = PixelBox { x: side("x"), y: side("y"), width: side("width"), height: side("height") };
            (drawn.overlap(&car.bounds), number(b, "distance"))
        });
        let (overlap, distance) = best.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or_default();
        boxed += usize::from(overlap > 0.5 && (distance - car.distance_m).abs() < 0.15 * car.distance_m);
        let free_m = shown["free"].as_f64().unwrap_or_default();
        // Far ahead, where the ground is seen at a flat angle, the free space ends early, but never behind the car.
        free += usize::from((0.75..1.1).contains(&(free_m / car.distance_m)));
        told += &format!(
            "frame {sequence}: grey levels differ by {mean:.1}; the car at {:.1} m, box overlap {overlap:.2}, \
             {distance:.1} m, free {free_m:.1} m\n",
            car.distance_m
        );
    }
    ([same, boxed, free], told)
}

#[test]
fn the_page_shows_frames_with_boxes_where_the_truth_has_them() {
    let Some(mut browser) = Browser::start() else { return };
    let bench = Bench::new();
    bench.configure(&format!("[source]\nkind = \"scene\"\nseed = 1\nfps = {FPS}\n"));
    // Every frame, however slow the machine is, so that tracks are those of a fast machine.
    let daemon = bench.start(&["replay", "scene:drive?seed=1", "--lockstep", "--loop", "--limit", "1000000"]);
    let viewer = Viewer::start(&bench, &[]);
    browser.open(&viewer.link);
    browser.look(1400, 900, false, "light");
    browser.until("typeof page === 'object' && page.frames >= 3");
    let ([same, boxed, free], told) = compare(&mut browser, &mut Drive::paper(1).at_rate(FPS));
    println!("{told}");
    assert_eq!(same, COMPARED, "pictures are not those of their numbers:\n{told}");
    // At five pairs a second a car that starts very near and leaves fast becomes a new track.
    assert!(boxed * 4 >= COMPARED * 3, "the car ahead is not in its box:\n{told}");
    assert!(free + 1 >= COMPARED, "the way is not free as far as the car:\n{told}");
    let drawn = browser.value(FREE_DRAWN);
    assert_eq!((&drawn["columns"], &drawn["ahead"]), (&80.into(), &12.into()), "{drawn}");
    // Lines across the road, one in ten metres, look the same in both.
    let changed = |place: &str| drawn[place].as_u64().expect("a count");
    assert!(changed("near") >= 8 && changed("left") >= 8 && changed("behind") == 0, "{drawn}");
    let says = |which: &str, part: &str| drawn[which].as_str().is_some_and(|text| text.contains(part));
    assert!(says("label", "free ahead 12.0 m") && says("none", "no road detected"), "{drawn}");

    let drawn = browser.value(PATH_DRAWN);
    assert!(drawn["changed"].as_u64() >= Some(8), "{drawn}");
    assert_eq!(drawn["lines"], serde_json::json!(["way", "way"]), "{drawn}");
    assert_eq!(drawn["none"], serde_json::json!([]), "{drawn}");
    assert_eq!(drawn["assumed"], serde_json::json!(["way assumed", "way assumed"]), "{drawn}");
    let said = "10.0 ± 0.1 m/s, 0.20 rad/s left (odometry, bus yaw rate; odometry and bus disagree)";
    assert_eq!(
        (&drawn["said"], &drawn["unknown"]),
        (&said.into(), &"own motion unknown: straight path".into())
    );
    let ends = |i: usize, end: &str| drawn["captions"][i].as_str().is_some_and(|text| text.ends_with(end));
    assert!(ends(0, "; blue: path") && ends(1, "; dashed: straight path"), "{drawn}");

    browser.until("page.frame.obstacles.length > 0");
    assert_eq!(
        browser.value(NUMBERS),
        serde_json::json!([["20", "30"], ["21", "30"]]),
        "numbers over numbers"
    );

    // The rest of the page is complete.
    for part in ["disparity", "v_disparity"] {
        browser.until(&format!("document.getElementById('{part}').naturalWidth > 100"));
    }
    browser.until("document.querySelectorAll('#path polyline')[0].getAttribute('points').length > 200");
    browser.until("page.points && page.points.byteLength > 8000");
    browser.until("document.querySelectorAll('#c-latency path').length === 6");
    browser.until("document.querySelectorAll('#processes tbody tr').length === 5");
    browser.until("document.querySelectorAll('#obstacles tbody tr').length > 0");
    // Everything that can be reached by keyboard has a name; every image has a description.
    let unnamed = "[...document.querySelectorAll('.panel')].filter((p) => p.tabIndex !== 0 || \
         !document.getElementById(p.getAttribute('aria-labelledby'))).length + \
         [...document.querySelectorAll('img')].filter((i) => !i.alt).length";
    assert_eq!(browser.value(unnamed), 0);
    browser.press("2");
    assert_eq!(browser.value("document.activeElement.getAttribute('aria-labelledby')"), "t-birds");
    browser.press("p");
    assert_eq!(browser.value("document.getElementById('pause').getAttribute('aria-pressed')"), "true");
    browser.until("document.querySelector('.stale').textContent.startsWith('paused')");
    browser.press("p");
    // A change of the alarm is announced to screen readers: the drive comes near enough.
    browser.until("document.getElementById('spoken').textContent.length > 0");

    // The daemon is restarted after SIGTERM and SIGKILL: the same page continues.
    let mut daemons = vec![daemon];
    for signal in ["TERM", "KILL"] {
        let daemon_pid = bench.status_when(|s| s["state"] == "running")["pid"].as_u64().unwrap() as u32;
        send(daemon_pid, signal);
        browser.until("document.getElementById('link').className === 'away'");
        browser.until("document.getElementById('alarm').className === 'off'");
        // Nor are its speed, rates and processes shown as current.
        assert_eq!(browser.value(CURRENT), serde_json::json!([]), "values of a lost daemon");
        let shown = browser.value("page.frames").as_u64().unwrap();
        daemons.push(bench.start(&["run"]));
        browser.until(&format!("page.frames > {} && page.live", shown + 3));
        assert_eq!(browser.value("page.connections"), 1, "the page kept its connection");
    }
    // The viewer itself is restarted.
    let address = viewer.address.clone();
    viewer.stop();
    browser.until("document.getElementById('link').className === 'away'");
    let viewer = Viewer::start(&bench, &["--bind", &address]);
    browser.until("page.connections === 2 && page.live");
    let shown = browser.value("page.frames").as_u64().unwrap();
    browser.until(&format!("page.frames > {shown}"));
    assert!(viewer.get("/metrics", "").contains("lookout_viewer_clients 1\n"));
    let last = bench.status_when(|s| s["state"] == "running")["pid"].as_u64().unwrap() as u32;
    send(last, "TERM");
    browser.until("document.getElementById('link').className === 'away'");
    viewer.stop();
}

#[test]
fn before_the_first_frame_the_page_says_that_it_waits() {
    let Some(mut browser) = Browser::start() else { return };
    let bench = Bench::new();
    let viewer = Viewer::start(&bench, &[]);
    browser.open(&viewer.link);
    browser.look(1400, 900, false, "light");
    browser.until("typeof page === 'object' && document.getElementById('link').className === 'away'");
    let text = |id: &str| format!("document.getElementById('{id}').textContent");
    for id in ["alarm-level", "birds-caption", "v-caption", "scale-text"] {
        assert_eq!(browser.value(&text(id)), "waiting for the first frame", "{id}");
    }
    let strip = "document.querySelector('.stale').getBoundingClientRect().height > 10 && \
                 document.querySelector('.stale').textContent";
    assert_eq!(browser.value(strip), "waiting for the first frame");
    assert_eq!(browser.value(&text("k-latency")), "waiting for the daemon");
    assert_eq!(
        browser.value("document.querySelector('#obstacles tbody').innerText"),
        "waiting for the first frame"
    );
    assert_eq!(browser.value("document.querySelector('#processes tbody').innerText"), "no daemon");
    browser.value("pause()");
    assert_eq!(browser.value(strip), "paused before the first frame");
    browser.value("pause()");
    // A daemon whose source gives no frames has seconds without latency and speed.
    let drawn = browser.value(
        r#"(() => {
          const second = { number: 0, rate_hz: 0, latency_ms: null, latency_worst_ms: null, stage_ms: null, dropped: 0,
            cpu_percent: 3, speed_m_s: null, state: "starting", calibration: "unknown", rung: null, temperatures: [],
            clocks: [] };
          const captions = (samples) => {
            drawCharts(samples, ["stereo"]);
            return ["latency", "speed"].map((name) => document.getElementById(`k-${name}`).textContent);
          };
          const frame = { ...second, number: 1, latency_ms: 30, latency_worst_ms: 40, stage_ms: [20] };
          return [captions([second]), captions([second, frame])[1]];
        })()"#,
    );
    let waits = "waiting for frames";
    assert_eq!(drawn, serde_json::json!([[waits, waits], "own motion unknown"]));
    viewer.stop();
}

#[test]
fn heat_and_clocks_are_drawn_over_time() {
    let Some(mut browser) = Browser::start() else { return };
    let bench = Bench::new();
    let recording = bench.record("drive", 4);
    let board = |file: &str, text: &str| {
        let path = bench.path("sys").join(file);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        // Atomically, as reads of the kernel's files are.
        std::fs::write(path.with_extension("new"), text).unwrap();
        std::fs::rename(path.with_extension("new"), path).unwrap();
    };
    board("class/thermal/thermal_zone0/type", "cpu-thermal\n");
    board("class/thermal/thermal_zone0/temp", "61500\n");
    board("devices/system/cpu/cpufreq/policy0/scaling_cur_freq", "1500000\n");
    bench.configure(&format!(
        "[source]\nkind = \"folder\"\npath = \"{recording}\"\nrepeat = true\nfps = 5\n\
         [heat]\nwatch = \"require\"\nzones = \"cpu*\"\nperiod_ms = 100\nfilter_s = 0\ndwell_s = 0.1\n\
         [board]\nsysfs = \"{}\"\n",
        bench.path("sys").display()
    ));
    let daemon = bench.start(&["run"]);
    let viewer = Viewer::start(&bench, &[]);
    browser.open(&viewer.link);
    browser.look(1400, 900, false, "light");
    let caption = |name: &str, part: &str| {
        format!(
            "typeof page === 'object' && document.getElementById('k-{name}').textContent.includes('{part}')"
        )
    };
    browser.until(&caption("heat", "cpu-thermal 61.5 °C"));
    browser.until(&caption("clock", "cpu0 1500 MHz"));
    browser.until(&caption("health", "heat (now normal)"));
    board("class/thermal/thermal_zone0/temp", "91000\n");
    board("devices/system/cpu/cpufreq/policy0/scaling_cur_freq", "900000\n");
    browser.until(&caption("heat", "cpu-thermal 91 °C"));
    browser.until(&caption("clock", "cpu0 900 MHz"));
    browser.until(&caption("health", "heat (now lower frame rate)"));
    // Both values are in the curves, and both rungs in the bar, with titles.
    let heights = "(name) => new Set(document.querySelector(`#c-${name} path`).getAttribute('d') \
                   .split(/[ML]/).filter(Boolean).map((p) => p.split(' ')[1])).size";
    assert!(browser.value(&format!("({heights})('heat')")).as_u64() >= Some(2));
    assert!(browser.value(&format!("({heights})('clock')")).as_u64() >= Some(2));
    for rung in ["normal", "lower frame rate"] {
        browser.until(&format!(
            "[...document.querySelectorAll('#c-health title')].some((t) => t.textContent === '{rung}')"
        ));
    }
    viewer.stop();
    daemon.signal("TERM");
    assert!(daemon.wait().status.success());
    bench.assert_clean();
}

/// The page in three windows; screenshots are saved in the folder of `LOOKOUT_PICTURES`.
#[test]
fn the_page_fits_a_desk_a_phone_and_the_night() {
    let Some(mut browser) = Browser::start() else { return };
    let bench = Bench::new();
    // Every frame, however slow the machine is, so that tracks are those of a fast machine.
    let daemon = bench.start(&["replay", "scene:drive", "--lockstep", "--loop", "--limit", "1000000"]);
    let viewer = Viewer::start(&bench, &[]);
    browser.open(&viewer.link);
    let keep = std::env::var_os("LOOKOUT_PICTURES").map(std::path::PathBuf::from);
    let mut brightness = Vec::new();
    let looks = [
        ("light", 1400, 1000, false, "light"),
        ("dark", 1400, 1000, false, "dark"),
        ("phone", 400, 844, true, "dark"),
    ];
    for (name, width, height, is_phone, scheme) in looks {
        browser.look(width, height, is_phone, scheme);
        browser.until("typeof page === 'object' && page.frames >= 3 && page.samples.length >= 2");
        if keep.is_some() {
            // With a history to show, and the car ahead near.
            browser.until("page.samples.length > 45 && page.frame.alarm.nearest_m < 11");
        }
        let before = browser.value("page.frames").as_u64().unwrap();
        browser.until(&format!("page.frames > {}", before + 1));
        // No wider than the window, with the left image in sight.
        let overflow = "document.documentElement.scrollWidth - innerWidth";
        assert!(browser.value(overflow).as_i64().unwrap() <= 0, "{name} is wider than its window");
        // Nor is a table wider than its panel, and no label touches another.
        let tables = "Math.max(...[...document.querySelectorAll('.scroll')].map((s) => s.scrollWidth - s.clientWidth))";
        assert!(browser.value(tables).as_i64() <= Some(0), "{name}: a table is wider than its panel");
        browser.until("page.frame && page.frame.obstacles.length > 0");
        let labels = browser.value(TOUCHING);
        assert!(labels["drawn"].as_u64() >= Some(4), "{name}: too few labels are drawn: {labels}");
        assert_eq!(labels["touching"], 0, "{name}: labels touch");
        let bottom = browser.value("document.getElementById('left').getBoundingClientRect().bottom");
        assert!(bottom.as_f64().unwrap() < f64::from(height), "{name}: the left image is below the window");
        let picture = browser.screenshot();
        let image = image::load_from_memory(&picture).unwrap().into_luma8();
        assert_eq!((image.width(), image.height()), (width, height));
        // The background between the panels.
        brightness.push(image.get_pixel(2, height / 2)[0]);
        if let Some(folder) = &keep {
            let rgb = image::load_from_memory(&picture).unwrap().into_rgb8();
            let mut bytes = Vec::new();
            image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 80).encode_image(&rgb).unwrap();
            std::fs::write(folder.join(format!("viewer-{name}.jpg")), bytes).unwrap();
        }
    }
    assert!(brightness[0] > 200 && brightness[1] < 60 && brightness[2] < 60, "{brightness:?}");
    viewer.stop();
    // A replay that is stopped before its end fails.
    daemon.signal("TERM");
    assert_eq!(daemon.wait().status.code(), Some(1));
    bench.assert_clean();
}

#[test]
fn two_viewers_change_no_byte_of_the_results() {
    let bench = Bench::new();
    let recording = bench.record("drive", 30);
    // Long enough for a viewer to find the daemon, which it polls for.
    let replay = |out: &str| {
        bench.ok(&["replay", &recording, "--lockstep", "--loop", "--limit", "600", "--out", out]);
    };
    replay("alone");
    let viewers = [Viewer::start(&bench, &[]), Viewer::start(&bench, &[])];
    let frames = std::thread::scope(|scope| {
        let watched = scope.spawn(|| replay("watched"));
        let pages: Vec<_> = viewers
            .iter()
            .map(|viewer| {
                scope.spawn(|| {
                    let (mut page, mut frames) = (viewer.socket(), BTreeSet::new());
                    let start = std::time::Instant::now();
                    let mut was_there = false;
                    loop {
                        let (answer, _) = page.ask();
                        frames.extend(answer["frame"]["sequence"].as_u64());
                        was_there |= answer["absent"].is_null();
                        if was_there && !answer["absent"].is_null() {
                            return frames.len();
                        }
                        assert!(start.elapsed() < WATCHDOG, "the replay never came, or never ended");
                    }
                })
            })
            .collect();
        watched.join().expect("the replay ends well");
        pages.into_iter().map(|page| page.join().expect("a page ends well")).collect::<Vec<_>>()
    });
    println!("frames seen of 600: {frames:?}");
    assert!(frames.iter().all(|&count| count > 0), "{frames:?}");
    let (alone, watched) = (files(&bench.path("alone")), files(&bench.path("watched")));
    assert!(alone.len() > 60);
    assert_eq!(alone.len(), watched.len());
    for ((name, a), (_, b)) in alone.iter().zip(&watched) {
        assert!(a == b, "{} differs when it is watched", name.display());
    }
    let [first, second] = viewers;
    first.stop();
    second.stop();
    bench.assert_clean();
}
