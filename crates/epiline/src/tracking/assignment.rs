//! Who is who at the least cost in all: the linear assignment problem, solved exactly.
//!
//! Shortest augmenting paths with dual variables (Jonker and Volgenant, Computing 38, 1987; the bookkeeping of Crouse,
//! IEEE Trans. AES 52, 2016). Taking the cheapest pair first is not enough: where two tracks share a gate it hands the
//! nearer obstacle to the one that has another, and the other track loses its own.

/// What [`Assignment::solve`] gives a row without a column.
pub const UNASSIGNED: usize = usize::MAX;

/// Solves assignment problems; keeps its buffers.
///
/// Every row has a private extra column at `miss_cost`, so every row can stay without a column.
#[derive(Debug, Clone, Default)]
pub struct Assignment {
    /// Dual variables.
    row_price: Vec<f64>,
    column_price: Vec<f64>,
    row_of_column: Vec<usize>,
    column_of_row: Vec<usize>,
    /// Of the search: cheapest way to each column, the column before it, and whether it is settled.
    distance: Vec<f64>,
    previous: Vec<usize>,
    settled: Vec<bool>,
}

impl Assignment {
    /// For each of `rows` rows the column it is assigned, or [`UNASSIGNED`], such that the sum of the costs, `miss_cost`
    /// for each row without a column, is smallest. `cost(row, column)` is finite, or infinite where a pair is
    /// forbidden.
    pub fn solve(
        &mut self,
        rows: usize,
        columns: usize,
        miss_cost: f64,
        cost: impl Fn(usize, usize) -> f64,
    ) -> &[usize] {
        let cost = |row: usize, column: usize| match column.checked_sub(columns) {
            None => cost(row, column),
            Some(private) if private == row => miss_cost,
            Some(_) => f64::INFINITY,
        };
        let all = columns + rows;
        refill(&mut self.row_price, rows, 0.0);
        refill(&mut self.column_price, all, 0.0);
        refill(&mut self.row_of_column, all, UNASSIGNED);
        for row in 0..rows {
            self.augment(row, all, &cost);
        }
        refill(&mut self.column_of_row, rows, UNASSIGNED);
        for (column, &row) in self.row_of_column[..columns].iter().enumerate() {
            if row != UNASSIGNED {
                self.column_of_row[row] = column;
            }
        }
        &self.column_of_row
    }

    /// Assigns one more row, moving others where that costs least.
    fn augment(&mut self, free_row: usize, all: usize, cost: &impl Fn(usize, usize) -> f64) {
        refill(&mut self.distance, all, f64::INFINITY);
        refill(&mut self.previous, all, UNASSIGNED);
        refill(&mut self.settled, all, false);
        let mut row = free_row;
        let mut from = UNASSIGNED;
        let mut reached = 0.0;
        let end = loop {
            let mut next = UNASSIGNED;
            for column in 0..all {
                if self.settled[column] {
                    continue;
                }
                let through = reached + cost(row, column) - self.row_price[row] - self.column_price[column];
                if through < self.distance[column] {
                    self.distance[column] = through;
                    self.previous[column] = from;
                }
                if next == UNASSIGNED || self.distance[column] < self.distance[next] {
                    next = column;
                }
            }
            // A row's private column is free while the row is: some column is always within reach.
            reached = self.distance[next];
            self.settled[next] = true;
            if self.row_of_column[next] == UNASSIGNED {
                break next;
            }
            (from, row) = (next, self.row_of_column[next]);
        };
        self.row_price[free_row] += reached;
        for column in 0..all {
            if self.settled[column] && column != end {
                let slack = reached - self.distance[column];
                self.row_price[self.row_of_column[column]] += slack;
                self.column_price[column] -= slack;
            }
        }
        let mut column = end;
        while column != UNASSIGNED {
            let before = self.previous[column];
            self.row_of_column[column] =
                if before == UNASSIGNED { free_row } else { self.row_of_column[before] };
            column = before;
        }
    }
}

fn refill<T: Clone>(values: &mut Vec<T>, length: usize, value: T) {
    values.clear();
    values.resize(length, value);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The least cost by trying everything.
    fn brute_force(costs: &[Vec<f64>], row: usize, taken: &mut Vec<usize>, miss_cost: f64) -> f64 {
        let Some(row_costs) = costs.get(row) else { return 0.0 };
        let mut best = miss_cost + brute_force(costs, row + 1, taken, miss_cost);
        for (column, &cost) in row_costs.iter().enumerate() {
            if !taken.contains(&column) {
                taken.push(column);
                best = best.min(cost + brute_force(costs, row + 1, taken, miss_cost));
                taken.pop();
            }
        }
        best
    }

    #[test]
    fn no_assignment_costs_less() {
        let mut state = 1_u64;
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f64 / f64::from(1 << 24)
        };
        let mut solver = Assignment::default();
        for case in 0..400 {
            let (rows, columns) = (case % 6, case / 6 % 6);
            let costs: Vec<Vec<f64>> =
                (0..rows)
                    .map(|_| {
                        (0..columns)
                            .map(|_| {
                                if uniform() < 0.3 { f64::INFINITY } else { (20.0 * uniform()).round() - 5.0 }
                            })
                            .collect()
                    })
                    .collect();
            let solution = solver.solve(rows, columns, 6.0, |row, column| costs[row][column]).to_vec();
            let mut seen = solution.iter().filter(|&&c| c != UNASSIGNED).collect::<Vec<_>>();
            seen.sort_unstable();
            assert!(seen.windows(2).all(|pair| pair[0] != pair[1]), "case {case}: a column twice");
            let of =
                |(row, &column): (usize, &usize)| if column == UNASSIGNED { 6.0 } else { costs[row][column] };
            let found: f64 = solution.iter().enumerate().map(of).sum();
            let best = brute_force(&costs, 0, &mut Vec::new(), 6.0);
            assert!((found - best).abs() < 1e-9, "case {case}: {found} where {best} is possible");
        }
    }
}
