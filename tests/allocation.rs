//! The algorithms of the stages allocate no heap memory after construction: counted frame by frame on a drive.

use messages::allocation::{CountingAllocator, by_this_thread};
use perception::depth::DepthView;
use perception::image::GreyView;
use perception::road::{RoadParameters, Shape};
use perception::scene::{SceneDetector, SceneParameters};
use perception::simd::Level;
use perception::stereo::{Crew, DisparityView, MatchOutput, Matcher, Mpv, MpvParameters, Search};
use sources::PairSource;
use sources::scene::Scene;

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

const DISPARITIES: usize = 64;

#[test]
fn a_frame_of_stereo_and_of_the_road_allocates_nothing() {
    let before = by_this_thread();
    drop(vec![1_u8; 100]);
    assert!(by_this_thread() > before, "the count counts");

    let mut scene = Scene::open("street").expect("the scene ships");
    let ((width, height), rig) = (scene.size(), scene.rig().expect("the scene has a rig"));
    let mut matchers = [1, 2].map(|threads| {
        let crew = Crew::new(threads, |_| ()).expect("there are threads");
        let (level, parameters) = (Level::best(), MpvParameters::default());
        Mpv::with_crew(crew, level, parameters, Search::Windows, width, height, DISPARITIES).expect("it fits")
    });
    let mut detectors = [Shape::Profile, Shape::Plane].map(|shape| {
        let road = RoadParameters { shape, ..RoadParameters::default() };
        let parameters = SceneParameters { road, ..SceneParameters::default() };
        SceneDetector::new(parameters, rig, width, height, DISPARITIES)
    });
    let (mut left, mut right) = (vec![0; width * height], vec![0; width * height]);
    let (mut disparity, mut confidence) = (vec![0; width * height], vec![0; width * height]);
    let (mut roads, mut most) = (0, 0);
    for index in 0..24 {
        // Every fifth frame of the drive, so that much changes; rendering may allocate.
        scene.read(5 * index, &mut left, &mut right).expect("the frame is drawn");
        let view = |pixels| GreyView::new(pixels, width, height, width).expect("it fits");
        for matcher in &mut matchers {
            let before = by_this_thread();
            let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
            matcher.compute(view(&left), view(&right), output).expect("it fits");
            assert_eq!(by_this_thread(), before, "stereo, frame {index}");
        }
        let map = DisparityView::new(&disparity, width, height).expect("it fits");
        let depth = DepthView::new(map, &confidence).expect("it fits");
        let with_images = depth.with_images([view(&left), view(&right)]).expect("they fit");
        // Every second frame without its images, as of LiDAR.
        let depth = if index % 2 == 0 { with_images } else { depth };
        for detector in &mut detectors {
            let before = by_this_thread();
            let scene = detector.detect(depth);
            let counted = (usize::from(scene.road.is_some()), scene.regions.len());
            assert_eq!(by_this_thread(), before, "road, frame {index}");
            (roads, most) = (roads + counted.0, most.max(counted.1));
        }
    }
    assert!(roads >= 40 && most >= 3, "there was something to find: {roads} roads, {most} regions");
}
