//! Groups overlapping hits into objects, like OpenCV's `groupRectangles` with `eps` = 0.2.

use super::scan::Window;

/// A group of overlapping hits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Group {
    /// Mean window of the hits.
    pub window: Window,
    /// Number of hits.
    pub hits: u32,
}

const EPS: f64 = 0.2;

/// Groups hits; its memory is reused.
#[derive(Debug, Default)]
pub struct Grouper {
    parent: Vec<u32>,
    order: Vec<u32>,
    class: Vec<u32>,
    sums: Vec<([i64; 4], u32)>,
    means: Vec<Group>,
    groups: Vec<Group>,
}

fn similar(a: &Window, b: &Window) -> bool {
    let delta = EPS * 0.5 * f64::from(a.width.min(b.width) + a.height.min(b.height));
    let near = |a: i32, b: i32| f64::from((a - b).abs()) <= delta;
    near(a.x, b.x)
        && near(a.y, b.y)
        && near(a.x + a.width, b.x + b.width)
        && near(a.y + a.height, b.y + b.height)
}

/// The first hit of the class of hit `i` (union-find with path halving).
fn root(parent: &mut [u32], mut i: u32) -> u32 {
    while parent[i as usize] != i {
        parent[i as usize] = parent[parent[i as usize] as usize];
        i = parent[i as usize];
    }
    i
}

impl Grouper {
    /// A grouper with memory for `capacity` hits.
    pub fn new(capacity: usize) -> Self {
        Self {
            parent: Vec::with_capacity(capacity),
            order: Vec::with_capacity(capacity),
            class: Vec::with_capacity(capacity),
            sums: Vec::with_capacity(capacity),
            means: Vec::with_capacity(capacity),
            groups: Vec::with_capacity(capacity),
        }
    }

    /// Groups of more than `min_neighbours` hits, in the order of their first hits, without groups that lie
    /// inside a group of more hits. With 0 every hit is a group.
    pub fn group(&mut self, hits: &[Window], min_neighbours: u32) -> &[Group] {
        self.groups.clear();
        if min_neighbours == 0 {
            self.groups.extend(hits.iter().map(|&window| Group { window, hits: 1 }));
            return &self.groups;
        }
        self.join(hits);
        self.sums.clear();
        self.class.clear();
        self.class.resize(hits.len(), u32::MAX);
        for (i, hit) in hits.iter().enumerate() {
            let root = root(&mut self.parent, i as u32) as usize;
            if self.class[root] == u32::MAX {
                self.class[root] = self.sums.len() as u32;
                self.sums.push(([0; 4], 0));
            }
            let (sum, count) = &mut self.sums[self.class[root] as usize];
            for (sum, value) in sum.iter_mut().zip([hit.x, hit.y, hit.width, hit.height]) {
                *sum += i64::from(value);
            }
            *count += 1;
        }
        self.means.clear();
        // Only classes of enough hits are kept, and only those suppress others.
        let sure = self.sums.iter().filter(|&&(_, hits)| hits > min_neighbours);
        self.means.extend(sure.map(|&(sum, hits)| {
            let share = 1.0 / hits as f32;
            let mean = |v: i64| f64::from(v as f32 * share).round_ties_even() as i32;
            let window =
                Window { x: mean(sum[0]), y: mean(sum[1]), width: mean(sum[2]), height: mean(sum[3]) };
            Group { window, hits }
        }));
        for (i, a) in self.means.iter().enumerate() {
            let inside_another = self.means.iter().enumerate().any(|(j, b)| {
                let slack = |side: i32| (f64::from(side) * EPS).round_ties_even() as i32;
                let (dx, dy) = (slack(b.window.width), slack(b.window.height));
                j != i
                    && a.window.x >= b.window.x - dx
                    && a.window.y >= b.window.y - dy
                    && a.window.x + a.window.width <= b.window.x + b.window.width + dx
                    && a.window.y + a.window.height <= b.window.y + b.window.height + dy
                    && (b.hits > a.hits.max(3) || a.hits < 3)
            });
            if !inside_another {
                self.groups.push(*a);
            }
        }
        &self.groups
    }

    /// Joins all pairs of similar hits. Hits are sorted by their left column, so the partners of a hit to its
    /// right lie within a distance that its size determines.
    fn join(&mut self, hits: &[Window]) {
        self.parent.clear();
        self.parent.extend(0..hits.len() as u32);
        self.order.clear();
        self.order.extend(0..hits.len() as u32);
        self.order.sort_unstable_by_key(|&i| (hits[i as usize].x, i));
        for (k, &i) in self.order.iter().enumerate() {
            let a = &hits[i as usize];
            let farthest = a.x + (EPS * 0.5 * f64::from(a.width + a.height)).ceil() as i32;
            for &j in &self.order[k + 1..] {
                let b = &hits[j as usize];
                if b.x > farthest {
                    break;
                }
                if similar(a, b) {
                    let (i, j) = (root(&mut self.parent, i), root(&mut self.parent, j));
                    // The first hit stays root.
                    self.parent[i.max(j) as usize] = i.min(j);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(x: i32, y: i32, side: i32) -> Window {
        Window { x, y, width: side, height: side }
    }

    #[test]
    fn near_hits_become_their_mean() {
        let hits = [window(10, 10, 30), window(12, 10, 30), window(80, 10, 30), window(11, 13, 30)];
        let mut grouper = Grouper::new(4);
        assert_eq!(grouper.group(&hits, 2), [Group { window: window(11, 11, 30), hits: 3 }]);
        assert_eq!(grouper.group(&hits, 3), []);
        assert_eq!(grouper.group(&hits, 0).len(), 4);
        assert_eq!(grouper.group(&[], 1), []);
    }

    #[test]
    fn a_weak_group_inside_a_strong_one_is_removed() {
        let mut hits = vec![window(10, 10, 60); 6];
        hits.extend([window(20, 20, 30); 2]);
        let groups = Grouper::default().group(&hits, 1).to_vec();
        assert_eq!(groups, [Group { window: window(10, 10, 60), hits: 6 }]);
    }

    #[test]
    fn chains_are_joined_as_all_pairs_would_join_them() {
        let mut random = fastrand::Rng::with_seed(4);
        for round in 0..50 {
            let hits: Vec<Window> =
                (0..60).map(|_| window(random.i32(0..120), random.i32(0..60), random.i32(20..50))).collect();
            let mut grouper = Grouper::default();
            grouper.join(&hits);
            let mut class: Vec<usize> = (0..hits.len()).collect();
            for i in 0..hits.len() {
                for j in 0..i {
                    if similar(&hits[i], &hits[j]) {
                        let (a, b) = (class[i].min(class[j]), class[i].max(class[j]));
                        class.iter_mut().filter(|c| **c == b).for_each(|c| *c = a);
                    }
                }
            }
            for (i, &expected) in class.iter().enumerate() {
                assert_eq!(root(&mut grouper.parent, i as u32) as usize, expected, "round {round}");
            }
        }
    }
}
