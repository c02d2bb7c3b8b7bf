use super::checkpoint::Checkpoint;
use super::finish::Aim;
use super::pictures::{SourcePicture, Split};
use super::trainer::Progress;
use super::*;
use crate::evaluation::detection::{judge_all, report as figures};
use fastrand::Rng;
use perception::image::GreyImage;
use perception::recognition::xml::TrainedWith;
use std::path::Path;

/// An image of noise; with an object, it has a dark roof over a bright window.
fn picture(seed: u64, side: usize, object: bool) -> SourcePicture {
    let mut random = Rng::with_seed(seed);
    let mut grey = GreyImage::new(side, side);
    for (i, v) in grey.as_mut_slice().iter_mut().enumerate() {
        let (x, y) = (i % side * 8 / side, i / side * 8 / side);
        let shape = match (x, y) {
            (1..7, 1..3) => 40,
            (2..6, 3..6) => 180,
            (_, 6..8) => 70,
            _ => 110,
        };
        let noise = random.u8(..120);
        *v = if object { shape / 2 + noise } else { noise + (x * 11 % 60) as u8 };
    }
    SourcePicture { path: format!("{seed}.png").into(), grey }
}

fn pictures(count: u64, side: usize, object: bool) -> Split {
    let of = |from: u64, count: u64| (from..from + count).map(|s| picture(s, side, object)).collect();
    Split {
        training: of(u64::from(object) * 1000, count),
        validation: of(5000 + u64::from(object) * 1000, count / 2),
    }
}

fn parameters(features: FeatureKind) -> TrainParameters {
    let mut p = TrainParameters::usual(features);
    p.window = (12, 12);
    p.stages = 3;
    p.stage.max_trees = 4;
    p.stage.false_alarm_rate = 0.2;
    p.pool = 150;
    p.variants = 2;
    p.negatives = 100;
    p
}

#[test]
fn objects_are_told_apart_and_threads_change_nothing() {
    for features in [FeatureKind::Lbp, FeatureKind::Haar, FeatureKind::HaarTilted] {
        let p = parameters(features);
        let run = |threads| {
            let p = TrainParameters { threads, ..p };
            let mut events = 0;
            let trained =
                train(&p, pictures(60, 20, true), pictures(60, 40, false), Vec::new(), &mut |_| events += 1);
            (trained.expect("a cascade"), events)
        };
        let (one, events) = run(1);
        assert!(events > one.cascade.stages.len(), "{features:?}: progress is reported");
        let (three, _) = run(3);
        assert_eq!(one.cascade, three.cascade, "{features:?}");
        assert_eq!(one.stages, three.stages, "{features:?}");
        let fresh = |object| -> Vec<SourcePicture> {
            (9000..9100).map(|s| picture(s + u64::from(object) * 500, 24, object)).collect()
        };
        let hits = judge_all(&one.cascade, &fresh(true), 2);
        let alarms = judge_all(&one.cascade, &fresh(false), 2);
        let figures = figures(&hits, &alarms, one.cascade.stages.len()).expect("figures");
        assert!(figures.balanced_accuracy > 0.9, "{features:?}: {figures:?}");
    }
}

#[test]
fn a_run_that_was_stopped_goes_on_to_the_same_cascade() {
    let with = TrainedWith { hit_rate: 0.9, false_alarm_rate: 0.5, max_depth: 2, max_trees: 10 };
    let folder = tempfile::tempdir().expect("a folder");
    let (objects, rest) = (pictures(50, 20, true), pictures(50, 40, false));
    for (chained, bags, stop) in [(true, 1, 1), (false, 1, 1), (true, 2, 4)] {
        let mut p = parameters(FeatureKind::Haar);
        (p.stage.chained, p.bags) = (chained, bags);
        p.aim = if chained { Aim::HitRate(0.9) } else { Aim::FalseAlarmRate(0.01) };
        let output = folder.path().join(format!("{chained}{bags}{stop}.xml"));
        let checkpoint = Checkpoint::new(&output, &p, &objects, &rest);
        assert!(checkpoint.load().expect("nothing there").is_none());
        let (mut cascades, mut figures) = (Vec::new(), Vec::new());
        let whole = train(&p, objects.clone(), rest.clone(), Vec::new(), &mut |event| {
            if let Progress::Done { bag, cascade, figures: stage } = event {
                cascades.truncate(bag);
                cascades.push(cascade.clone());
                figures.push(*stage);
                if figures.len() == stop {
                    checkpoint.save(&cascades, &with, &figures).expect("kept");
                }
            }
        })
        .expect("a cascade");
        assert!(whole.cascade.stages.len() > 1);
        let begun = checkpoint.load().expect("sound").expect("there");
        assert_eq!(begun.figures, figures[..stop]);
        let rest_of_it =
            train(&p, objects.clone(), rest.clone(), begun.cascades, &mut |_| ()).expect("a cascade");
        assert_eq!(rest_of_it.cascade, whole.cascade, "chained: {chained}, {bags} bags, {stop} stages");
        assert_eq!(rest_of_it.stages, figures[stop..]);
        // Other options give another cascade.
        let other = Checkpoint::new(&output, &TrainParameters { seed: 2, ..p }, &objects, &rest);
        let error = other.load().expect_err("another seed").to_string();
        assert!(error.contains("--restart") && error.contains(".part"), "{error}");
        std::fs::write(checkpoint.path(), "{").expect("written");
        assert!(checkpoint.load().expect_err("broken").to_string().contains("not a checkpoint"));
        checkpoint.remove().expect("removed");
        checkpoint.remove().expect("nothing to remove");
    }
}

#[test]
fn bags_are_other_cascades_and_the_last_stage_has_the_trees_of_all() {
    let mut p = parameters(FeatureKind::Haar);
    p.aim = Aim::FalseAlarmRate(0.05);
    let (objects, rest) = (pictures(60, 20, true), pictures(60, 40, false));
    let run = |bags, threads| {
        let p = TrainParameters { bags, threads, ..p };
        train(&p, objects.clone(), rest.clone(), Vec::new(), &mut |_| ()).expect("a cascade")
    };
    let (one, three) = (run(1, 1), run(3, 1));
    assert_eq!(three.cascade, run(3, 3).cascade, "the threads change nothing");
    let first = one.cascade.stages.len();
    assert_eq!(three.cascade.stages.len(), first + 2);
    assert_eq!(three.cascade.stages[..first - 1], one.cascade.stages[..first - 1]);
    let trees: Vec<_> = three.cascade.stages[first - 1..].iter().map(|stage| &stage.trees).collect();
    assert_eq!(trees[0], &one.cascade.stages[first - 1].trees);
    assert!(trees.windows(2).all(|pair| pair[1].starts_with(pair[0]) && pair[1].len() > pair[0].len()));
    let added = &trees[2][trees[0].len()..];
    assert!(added.iter().any(|tree| !trees[0].contains(tree)), "other random numbers, other trees");
    assert!(three.stages.len() > one.stages.len());
    // On the validation patches.
    let alarms = judge_all(&three.cascade, &rest.validation, 1);
    assert!(alarms.iter().filter(|v| v.hit(0.0)).count() <= alarms.len() / 20);
    let unchained =
        TrainParameters { bags: 2, stage: stage::StageParameters { chained: false, ..p.stage }, ..p };
    let error = train(&unchained, objects, rest, Vec::new(), &mut |_| ()).expect_err("no common stages");
    assert!(error.to_string().contains("--bags 1"), "{error}");
}

#[test]
fn too_few_pictures_are_refused_with_the_remedy() {
    let p = parameters(FeatureKind::Lbp);
    let run =
        |objects, rest| train(&p, objects, rest, Vec::new(), &mut |_| ()).expect_err("too few").to_string();
    assert!(run(Split::default(), pictures(10, 40, false)).contains("--validation 0"));
    let small = run(pictures(10, 20, true), pictures(10, 8, false));
    assert!(small.contains("at least 12x12 pixels"), "{small}");
}

#[test]
fn a_report_has_all_its_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let p = parameters(FeatureKind::HaarTilted);
    let (objects, rest) = (pictures(40, 20, true), pictures(40, 40, false));
    let trained = train(&p, objects.clone(), rest.clone(), Vec::new(), &mut |_| ()).expect("a cascade");
    let hits = judge_all(&trained.cascade, &objects.validation, 1);
    let alarms = judge_all(&trained.cascade, &rest.validation, 1);
    let validation = figures(&hits, &alarms, trained.cascade.stages.len()).expect("figures");
    report::write(folder.path(), &trained.cascade, &trained.stages, Some(&validation), &objects.training)
        .expect("written");
    for file in ["training.json", "stages.txt", "stages.png", "roc.png", "features.png"] {
        assert!(folder.path().join(file).is_file(), "{file}");
    }
    let blocked = folder.path().join("stages.txt");
    let error = report::write(Path::new(&blocked), &trained.cascade, &trained.stages, None, &[]);
    assert!(error.expect_err("a file is no folder").to_string().contains("stages.txt"));
}

#[test]
fn the_ablation_judges_each_change_by_pictures_that_took_no_part() {
    let sequences = |object: bool, side: usize| -> Vec<Vec<SourcePicture>> {
        (0..2).map(|folder| (0..30).map(|s| picture(s + 100 * folder, side, object)).collect()).collect()
    };
    let mut p = parameters(FeatureKind::Lbp);
    p.stages = 1;
    let mut changes = Vec::new();
    let table =
        ablation::ablation(&p, sequences(true, 20), sequences(false, 20), 0.3, &mut |change, event| {
            if let Progress::Done { .. } = event {
                changes.push(change.to_owned());
            }
        })
        .expect("a table");
    assert_eq!((table.positives, table.negatives, table.rows.len()), (18, 18, 11));
    // One stage each, and three where there are three bags.
    assert_eq!(changes.len(), 13, "{changes:?}");
    assert!(table.rows[0].area > 0.9, "{:?}", table.rows[0]);
    assert!(table.text().contains("each stage from nothing"));
}
