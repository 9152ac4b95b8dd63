//! The outline of what stands upright, seen from above: disparity over columns as a line with few corners.

/// A column and the disparity seen there.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Point {
    pub x: f64,
    pub disparity_px: f64,
    /// Pixels.
    pub weight: f64,
}

/// Fits outlines; keeps its memory.
#[derive(Debug, Clone, Default)]
pub(super) struct Outliner {
    smooth: Vec<f64>,
    open: Vec<(usize, usize)>,
    /// Indices of the corners of the last outline, ends included, in order.
    pub corners: Vec<usize>,
    diagonal: Vec<f64>,
    beside: Vec<f64>,
    right_side: Vec<f64>,
}

impl Outliner {
    /// Takes points that are farther than `tolerance_px` from the median of the five around them, or of the five at an
    /// end, for that median: a few pixels of something else decide about no range.
    pub fn steady(&mut self, points: &mut [Point], tolerance_px: f64) {
        let count = points.len().min(5);
        self.smooth.clear();
        for i in 0..points.len() {
            let first = i.saturating_sub(2).min(points.len() - count);
            let mut around = [f64::INFINITY; 5];
            for (value, point) in around.iter_mut().zip(&points[first..first + count]) {
                *value = point.disparity_px;
            }
            around[..count].sort_unstable_by(f64::total_cmp);
            self.smooth.push(around[count / 2]);
        }
        for (point, &median_px) in points.iter_mut().zip(&self.smooth) {
            if (point.disparity_px - median_px).abs() > tolerance_px {
                point.disparity_px = median_px;
            }
        }
    }

    /// Finds the corners of points in order of their columns, of which there is at least one: the points where the
    /// outline leaves the straight line between other corners by more than `tolerance_px` (Ramer 1972).
    pub fn find_corners(&mut self, points: &[Point], tolerance_px: f64) {
        median_of_five(points, &mut self.smooth);
        self.corners.clear();
        self.corners.push(0);
        self.open.clear();
        self.open.push((0, points.len() - 1));
        while let Some((first, last)) = self.open.pop() {
            let farthest = (first + 1..last)
                .map(|i| (off_line(points, &self.smooth, first, last, i).abs(), i))
                .max_by(|a, b| a.0.total_cmp(&b.0));
            match farthest {
                Some((off_px, corner)) if off_px > tolerance_px => {
                    self.open.push((corner, last));
                    self.open.push((first, corner));
                }
                _ if last != first => self.corners.push(last),
                _ => {}
            }
        }
    }

    /// By how much the fitted outline bends away from the camera at a corner: how much farther it is than the line
    /// between its neighbours, px.
    pub fn recess_px(&self, points: &[Point], fitted: &[f64], corner: usize) -> f64 {
        let [before, here, after] = [corner - 1, corner, corner + 1].map(|i| points[self.corners[i]].x);
        let share = (here - before) / (after - before);
        fitted[corner - 1] + share * (fitted[corner + 1] - fitted[corner - 1]) - fitted[corner]
    }

    /// Disparities at the corners of the line, bent only there, that is nearest to the points in the least-squares sense.
    ///
    /// `fitted` takes one value per corner. Normal equations of hat functions are tridiagonal (Thomas's algorithm).
    pub fn fit(&mut self, points: &[Point], fitted: &mut Vec<f64>) {
        let n = self.corners.len();
        for buffer in [&mut self.diagonal, &mut self.beside, &mut self.right_side] {
            buffer.clear();
            buffer.resize(n, 0.0);
        }
        for segment in 0..n.saturating_sub(1).max(1) {
            let first = self.corners[segment];
            let last = self.corners[(segment + 1).min(n - 1)];
            let length = points[last].x - points[first].x;
            // A corner belongs to the segment before it, the first one to the first.
            let begin = if segment == 0 { first } else { first + 1 };
            for point in &points[begin..=last] {
                let after = if length > 0.0 { (point.x - points[first].x) / length } else { 0.0 };
                let before = 1.0 - after;
                let weight = point.weight;
                self.diagonal[segment] += weight * before * before;
                self.right_side[segment] += weight * before * point.disparity_px;
                if n > 1 {
                    self.diagonal[segment + 1] += weight * after * after;
                    self.beside[segment] += weight * before * after;
                    self.right_side[segment + 1] += weight * after * point.disparity_px;
                }
            }
        }
        for i in 1..n {
            let factor = self.beside[i - 1] / self.diagonal[i - 1];
            self.diagonal[i] -= factor * self.beside[i - 1];
            self.right_side[i] -= factor * self.right_side[i - 1];
        }
        fitted.clear();
        fitted.resize(n, 0.0);
        for i in (0..n).rev() {
            let after = if i + 1 < n { self.beside[i] * fitted[i + 1] } else { 0.0 };
            fitted[i] = (self.right_side[i] - after) / self.diagonal[i];
        }
    }
}

/// How much nearer a point is than the line between two others, px.
fn off_line(points: &[Point], smooth: &[f64], first: usize, last: usize, at: usize) -> f64 {
    let share = (points[at].x - points[first].x) / (points[last].x - points[first].x);
    smooth[at] - (smooth[first] + share * (smooth[last] - smooth[first]))
}

fn median_of_five(points: &[Point], out: &mut Vec<f64>) {
    out.clear();
    for i in 0..points.len() {
        let reach = 2.min(i).min(points.len() - 1 - i);
        let mut around = [0.0; 5];
        let count = 2 * reach + 1;
        for (value, point) in around.iter_mut().zip(&points[i - reach..=i + reach]) {
            *value = point.disparity_px;
        }
        around[..count].sort_unstable_by(f64::total_cmp);
        out.push(around[reach]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(of: impl Fn(f64) -> f64) -> Vec<Point> {
        (0..60).map(|x| Point { x: f64::from(x), disparity_px: of(f64::from(x)), weight: 1.0 }).collect()
    }

    /// A median levels the five points about a bend: its corner is found to within a column.
    #[test]
    fn a_bent_line_has_its_corners_where_it_bends() {
        let tent = points(|x| 20.0 - 0.2 * (x - 25.0).abs());
        let mut outliner = Outliner::default();
        outliner.find_corners(&tent, 0.5);
        let at_bend = |corners: &[usize]| matches!(corners, [0, 24..=26, 59]);
        assert!(at_bend(&outliner.corners), "{:?}", outliner.corners);
        let mut fitted = Vec::new();
        outliner.fit(&tent, &mut fitted);
        assert!(outliner.recess_px(&tent, &fitted, 1) < 0.0);
        for (got, expected) in fitted.iter().zip([15.0, 20.0, 13.2]) {
            assert!((got - expected).abs() < 0.2, "{fitted:?}");
        }
        let valley = points(|x| 20.0 + 0.2 * (x - 25.0).abs());
        outliner.find_corners(&valley, 0.5);
        assert!(at_bend(&outliner.corners), "{:?}", outliner.corners);
        outliner.fit(&valley, &mut fitted);
        assert!(outliner.recess_px(&valley, &fitted, 1) > 3.0);
    }

    /// A step between two surfaces stays; lone points beside it, at an end, or inside do not.
    #[test]
    fn lone_points_are_moved_to_their_neighbours() {
        let step = points(|x| if x < 30.0 { 20.0 } else { 10.0 });
        let mut outliner = Outliner::default();
        let mut steadied = step.clone();
        outliner.steady(&mut steadied, 0.75);
        assert_eq!(steadied, step);
        // Within two points behind a step, a nearer one would move the step to itself.
        for at in [0, 1, 12, 28, 33, 59] {
            steadied[at].disparity_px = 40.0;
            outliner.steady(&mut steadied, 0.75);
            assert_eq!(steadied, step, "{at}");
        }
    }

    #[test]
    fn one_and_two_points_are_outlines() {
        let mut outliner = Outliner::default();
        let mut fitted = Vec::new();
        for count in [1, 2] {
            let few = &points(|x| 5.0 + x)[..count];
            outliner.find_corners(few, 0.5);
            outliner.fit(few, &mut fitted);
            assert_eq!(fitted.len(), count);
            for (got, point) in fitted.iter().zip(few) {
                assert!((got - point.disparity_px).abs() < 1e-9);
            }
        }
    }
}
