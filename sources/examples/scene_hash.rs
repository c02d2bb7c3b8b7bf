use lookout_sources::PairSource;
use lookout_sources::scene::{Scene, library};
use std::hash::{DefaultHasher, Hash, Hasher};
fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let names: Vec<String> =
        if args.is_empty() { library::SCENES.iter().map(|s| s.0.to_owned()).collect() } else { args };
    for name in names {
        for name in
            [name.clone(), format!("{name}?weather=backlight"), format!("{name}?rig=kitti&weather=night")]
        {
            let mut s = Scene::open(&name).unwrap();
            let n = s.count().unwrap_or(150);
            for k in [0, n / 3, 2 * n / 3, n - 1] {
                let f = s.frame(k);
                let mut h = DefaultHasher::new();
                f.left.hash(&mut h);
                f.right.hash(&mut h);
                let i = h.finish();
                let t = &f.truth;
                for d in &t.disparity_px {
                    d.to_bits().hash(&mut h);
                }
                t.in_both.hash(&mut h);
                t.owner.hash(&mut h);
                format!("{:?}", t.road).hash(&mut h);
                println!("{name} {k} {i:x} {:x}", h.finish());
                for o in &t.objects {
                    println!(
                        "   {} {:?} {} {:?} {:?} {:?} {:?} {:?} {:?} {} {:?} {:?} {} {}",
                        o.id,
                        o.class,
                        o.subject,
                        o.distance_m,
                        o.lateral_m,
                        o.width_m,
                        o.height_m,
                        o.closing_m_s,
                        o.bounds,
                        o.pixels,
                        o.visible,
                        o.seen_by_both,
                        o.in_path,
                        o.on_road
                    );
                }
            }
        }
    }
}
