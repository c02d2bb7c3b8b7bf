//! Groups overlapping hits into objects, as OpenCV's `groupRectangles` does with eps 0.2.

use super::scan::{MOST_HITS, Window};

/// Overlapping hits, and their mean window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Group {
    /// Mean window of the hits.
    pub window: Window,
    /// How many hits.
    pub hits: u32,
}

const EPS: f64 = 0.2;

/// Groups hits, keeping its memory.
#[derive(Debug)]
pub struct Grouper {
    parent: Vec<usize>,
    sums: Vec<([i64; 4], u32)>,
    class: Vec<usize>,
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

impl Default for Grouper {
    fn default() -> Self {
        Self::new()
    }
}

impl Grouper {
    /// A grouper with memory for all hits of a scan.
    pub fn new() -> Self {
        Self {
            parent: Vec::with_capacity(MOST_HITS),
            sums: Vec::with_capacity(MOST_HITS),
            class: Vec::with_capacity(MOST_HITS),
            means: Vec::with_capacity(MOST_HITS),
            groups: Vec::with_capacity(MOST_HITS),
        }
    }

    fn root(&self, mut i: usize) -> usize {
        while self.parent[i] != i {
            i = self.parent[i];
        }
        i
    }

    /// Groups of more than `least_neighbours` hits, in the order of their first hits, without
    /// those that lie inside a surer one. With 0 every hit is its own group.
    pub fn group(&mut self, hits: &[Window], least_neighbours: u32) -> &[Group] {
        self.groups.clear();
        if least_neighbours == 0 {
            self.groups.extend(hits.iter().map(|&window| Group { window, hits: 1 }));
            return &self.groups;
        }
        self.parent.clear();
        self.parent.extend(0..hits.len());
        for i in 0..hits.len() {
            for j in 0..i {
                if similar(&hits[i], &hits[j]) {
                    let (a, b) = (self.root(i), self.root(j));
                    // The first hit stays root.
                    let (low, high) = (a.min(b), a.max(b));
                    self.parent[high] = low;
                }
            }
        }
        self.sums.clear();
        self.class.clear();
        self.class.resize(hits.len(), usize::MAX);
        for (i, hit) in hits.iter().enumerate() {
            let root = self.root(i);
            if self.class[root] == usize::MAX {
                self.class[root] = self.sums.len();
                self.sums.push(([0; 4], 0));
            }
            let (sum, count) = &mut self.sums[self.class[root]];
            for (sum, value) in sum.iter_mut().zip([hit.x, hit.y, hit.width, hit.height]) {
                *sum += i64::from(value);
            }
            *count += 1;
        }
        self.means.clear();
        self.means.extend(self.sums.iter().map(|&(sum, hits)| {
            let share = 1.0 / hits as f32;
            let mean = |v: i64| f64::from(v as f32 * share).round_ties_even() as i32;
            let window =
                Window { x: mean(sum[0]), y: mean(sum[1]), width: mean(sum[2]), height: mean(sum[3]) };
            Group { window, hits }
        }));
        for (i, a) in self.means.iter().enumerate() {
            if a.hits <= least_neighbours {
                continue;
            }
            let inside_another = self.means.iter().enumerate().any(|(j, b)| {
                let slack = |side: i32| (f64::from(side) * EPS).round_ties_even() as i32;
                let (dx, dy) = (slack(b.window.width), slack(b.window.height));
                j != i
                    && b.hits > least_neighbours
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
        let mut grouper = Grouper::new();
        assert_eq!(grouper.group(&hits, 2), [Group { window: window(11, 11, 30), hits: 3 }]);
        assert_eq!(grouper.group(&hits, 3), []);
        assert_eq!(grouper.group(&hits, 0).len(), 4);
        assert_eq!(grouper.group(&[], 1), []);
    }

    #[test]
    fn a_weak_group_inside_a_sure_one_goes() {
        let mut hits = vec![window(10, 10, 60); 6];
        hits.extend([window(20, 20, 30); 2]);
        let groups = Grouper::new().group(&hits, 1).to_vec();
        assert_eq!(groups, [Group { window: window(10, 10, 60), hits: 6 }]);
    }
}
