//! Networks against the framework that they were trained with: `parity/operators.txt`, written by `parity/network.py`, and
//! `parity/objects.txt`, written by `models/objects.py train --check`, hold what PyTorch computes.

use lookout_perception::image::GreyView;
use lookout_perception::recognition::network::sample::Rectangle;
use lookout_perception::recognition::network::{Network, NetworkRecogniser};

/// What differs is the order of sums, and the resizing where a network is shown a picture.
const TOLERANCE: f32 = 1e-4;

fn rows(text: &str) -> Vec<Vec<f32>> {
    let lines = text.lines().filter(|line| !line.starts_with('#') && !line.is_empty());
    lines.map(|line| line.split(' ').map(|v| v.parse().expect("a number")).collect()).collect()
}

#[test]
fn all_operators_are_those_of_pytorch() {
    let network = Network::read(include_bytes!("parity/operators.onnx")).expect("a network");
    assert_eq!((network.input(), network.margin()), ((28, 20), 0.25));
    let mut recogniser = NetworkRecogniser::new(network, 64, 64);
    let expected = rows(include_str!("parity/operators.txt"));
    assert_eq!(expected.len(), 4);
    for (k, expected) in expected.iter().enumerate() {
        let numbers = (0..20 * 28).map(|i| {
            let wave = (i / 28 * (k + 1) + 2 * (i % 28)) % 16;
            ((k * 20 * 28 + i) * 7919 % 1009) as f32 / 1009.0 * 2.0 - 1.0 + wave as f32 / 4.0
        });
        let found = recogniser.output(&numbers.collect::<Vec<_>>()).to_vec();
        // The softmax at the end is left out: what is common to all numbers does not matter.
        let sum: f32 = found.iter().map(|v| v.exp()).sum();
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - sum.ln() - expected).abs() < TOLERANCE, "{k}: {found} {expected}");
        }
    }
}

/// The picture of `check_picture` in `models/objects.py`.
fn picture(seed: usize) -> Vec<u8> {
    let level = |x: usize, y: usize| {
        let block = (x / 5 * 31 + y / 7 * 17 + seed * 13) * 2_654_435_761 % 4_294_967_296;
        (block >> 24) / 2 + (x * 3 + y * (seed + 1)) % 97
    };
    (0..32 * 32).map(|i| level(i % 32, i / 32) as u8).collect()
}

#[test]
fn the_networks_that_ship_say_what_they_said_when_they_were_trained() {
    for (network, expected) in [
        (&include_bytes!("../../models/objects.onnx")[..], include_str!("parity/objects.txt")),
        (&include_bytes!("../../models/objects-free.onnx")[..], include_str!("parity/objects-free.txt")),
    ] {
        let network = Network::read(network).expect("a network");
        let labels: Vec<&str> = network.labels().iter().map(|label| &label[..]).collect();
        assert_eq!((labels, network.input()), (vec!["other", "vehicle", "pedestrian", "rider"], (32, 32)));
        // The region whose surroundings are the picture.
        let side = 32.0 / (1.0 + 2.0 * network.margin());
        let inset = network.margin() * side;
        let region = Rectangle { x: inset, y: inset, width: side, height: side };
        let mut recogniser = NetworkRecogniser::new(network, 32, 32);
        let expected = rows(expected);
        assert_eq!(expected.len(), 6);
        for (seed, expected) in expected.iter().enumerate() {
            let pixels = picture(seed);
            let view = GreyView::new(&pixels, 32, 32, 32).expect("a picture");
            let found = recogniser.classify(view, region);
            for (found, expected) in found.iter().zip(expected) {
                assert!((found - expected).abs() < 10.0 * TOLERANCE, "{seed}: {found} {expected}");
            }
        }
    }
}
