//! Optimal one-to-one assignment of regions to tracks.
//!
//! Shortest augmenting paths (Jonker-Volgenant), extended by a fixed cost for an unmatched row. The result is
//! the global optimum, not a greedy one.

/// Cost of an impossible pair.
pub const INFEASIBLE: f64 = f64::INFINITY;

/// Solves assignment problems up to a solution size; memory is allocated once.
#[derive(Debug)]
pub struct Assignment {
    /// Largest number of columns.
    max_columns: usize,
    costs: Vec<f64>,
    columns: usize,
    row_price: Vec<f64>,
    column_price: Vec<f64>,
    /// Row assigned to each column.
    row_of: Vec<Option<u32>>,
    distance: Vec<f64>,
    from: Vec<u32>,
    done: Vec<bool>,
    column_of: Vec<Option<u32>>,
}

impl Assignment {
    /// Memory for `rows` × `columns`.
    pub fn new(rows: usize, columns: usize) -> Self {
        // Each row has one more, private column that stands for "unmatched"; these follow the real columns.
        let all = columns + rows;
        Self {
            max_columns: columns,
            costs: Vec::with_capacity(rows * columns),
            columns: 0,
            row_price: Vec::with_capacity(rows),
            column_price: Vec::with_capacity(all),
            row_of: Vec::with_capacity(all),
            distance: Vec::with_capacity(all),
            from: Vec::with_capacity(all),
            done: Vec::with_capacity(all),
            column_of: Vec::with_capacity(rows),
        }
    }

    /// Starts a problem of `rows` × `columns` in which all pairs are impossible.
    pub fn begin(&mut self, rows: usize, columns: usize) {
        self.columns = columns.min(self.max_columns);
        self.costs.clear();
        self.costs.resize(rows * self.columns, INFEASIBLE);
    }

    /// Sets the cost of assigning `column` to `row`.
    pub fn set(&mut self, row: usize, column: usize, cost: f64) {
        if column < self.columns {
            self.costs[row * self.columns + column] = cost;
        }
    }

    /// Solves the problem. Returns the column of each row; `None` for unmatched rows, each of which costs
    /// `unmatched_cost`.
    pub fn solve(&mut self, unmatched_cost: f64) -> &[Option<u32>] {
        let columns = self.columns;
        let rows = self.costs.len().checked_div(columns).unwrap_or(0);
        let all = columns + rows;
        fill(&mut self.row_price, rows, 0.0);
        fill(&mut self.column_price, all, 0.0);
        fill(&mut self.row_of, all, None);
        fill(&mut self.column_of, rows, None);
        for start in 0..rows {
            fill(&mut self.distance, all, INFEASIBLE);
            fill(&mut self.from, all, 0);
            fill(&mut self.done, all, false);
            let (mut row, mut reached) = (start, 0.0);
            let end = loop {
                for column in 0..all {
                    let cost = match column.checked_sub(columns) {
                        None => self.costs[row * columns + column],
                        Some(own) if own == row => unmatched_cost,
                        Some(_) => continue,
                    };
                    let through = reached + cost - self.row_price[row] - self.column_price[column];
                    if !self.done[column] && through < self.distance[column] {
                        self.distance[column] = through;
                        self.from[column] = row as u32;
                    }
                }
                // Always exists: the private column of the row.
                let mut next = None::<usize>;
                for column in 0..all {
                    let d = self.distance[column];
                    if !self.done[column] && d < INFEASIBLE && next.is_none_or(|n| d < self.distance[n]) {
                        next = Some(column);
                    }
                }
                let Some(column) = next else { break None };
                self.done[column] = true;
                reached = self.distance[column];
                match self.row_of[column] {
                    None => break Some(column),
                    Some(taken) => row = taken as usize,
                }
            };
            let Some(mut column) = end else { continue };
            for other in 0..all {
                if self.done[other] && other != column {
                    let gain = reached - self.distance[other];
                    self.column_price[other] -= gain;
                    if let Some(row) = self.row_of[other] {
                        self.row_price[row as usize] += gain;
                    }
                }
            }
            self.row_price[start] += reached;
            // Augment along the path back to the start.
            loop {
                let row = self.from[column];
                let before = self.column_of[row as usize].replace(column as u32);
                self.row_of[column] = Some(row);
                match before {
                    Some(column_before) if row as usize != start => column = column_before as usize,
                    _ => break,
                }
            }
        }
        for column in &mut self.column_of {
            *column = column.filter(|&c| (c as usize) < columns);
        }
        &self.column_of
    }
}

fn fill<T: Clone>(list: &mut Vec<T>, count: usize, value: T) {
    list.clear();
    list.resize(count, value);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn solve(costs: &[&[f64]], unmatched_cost: f64) -> Vec<Option<u32>> {
        let mut assignment = Assignment::new(8, 8);
        assignment.begin(costs.len(), costs.first().map_or(0, |r| r.len()));
        for (row, line) in costs.iter().enumerate() {
            for (column, &cost) in line.iter().enumerate() {
                assignment.set(row, column, cost);
            }
        }
        assignment.solve(unmatched_cost).to_vec()
    }

    #[test]
    fn the_assignment_is_globally_optimal_not_greedy() {
        // A greedy solution would take (0, 0) at cost 1 and leave 10 for row 1.
        assert_eq!(solve(&[&[1.0, 2.0], &[1.5, 10.0]], 20.0), [Some(1), Some(0)]);
        assert_eq!(solve(&[&[1.0, INFEASIBLE], &[2.0, INFEASIBLE]], 5.0), [Some(0), None]);
        assert_eq!(solve(&[&[7.0]], 5.0), [None]);
        assert_eq!(solve(&[&[], &[]], 5.0), []);
    }

    #[test]
    fn no_other_assignment_is_cheaper() {
        let unmatched_cost = 4.0;
        for seed in 0..300 {
            let mut random = fastrand::Rng::with_seed(seed);
            let (rows, columns) = (random.usize(1..5), random.usize(1..5));
            let costs: Vec<Vec<f64>> = (0..rows)
                .map(|_| {
                    (0..columns)
                        .map(|_| if random.u8(0..4) == 0 { INFEASIBLE } else { random.f64() * 6.0 })
                        .collect()
                })
                .collect();
            let lines: Vec<&[f64]> = costs.iter().map(Vec::as_slice).collect();
            let solution = solve(&lines, unmatched_cost);
            let price = |solution: &[Option<u32>]| -> f64 {
                solution
                    .iter()
                    .enumerate()
                    .map(|(r, c)| c.map_or(unmatched_cost, |c| costs[r][c as usize]))
                    .sum()
            };
            let mut taken: Vec<u32> = solution.iter().flatten().copied().collect();
            taken.sort_unstable();
            taken.dedup();
            assert_eq!(taken.len(), solution.iter().flatten().count(), "seed {seed}: a column twice");
            // Every possible assignment.
            let assignments = (columns as u32 + 1).pow(rows as u32);
            let mut best = INFEASIBLE;
            for assignment in 0..assignments {
                let mut rest = assignment;
                let trial: Vec<Option<u32>> = (0..rows)
                    .map(|_| {
                        let c = rest % (columns as u32 + 1);
                        rest /= columns as u32 + 1;
                        (c < columns as u32).then_some(c)
                    })
                    .collect();
                let mut used: Vec<u32> = trial.iter().flatten().copied().collect();
                used.sort_unstable();
                let double = used.windows(2).any(|w| w[0] == w[1]);
                if !double {
                    best = best.min(price(&trial));
                }
            }
            assert!((price(&solution) - best).abs() < 1e-9, "seed {seed}: {} for {best}", price(&solution));
        }
    }
}
