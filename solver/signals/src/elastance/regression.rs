//! Least-squares lines and polynomials.

/// A line y = slope (x − intercept).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Line {
    /// Slope, y's unit over x's.
    pub(super) slope: f64,
    /// x at which y is zero.
    pub(super) intercept: f64,
    /// Standard errors of slope and intercept; none for two points, which leave no residual.
    pub(super) standard_errors: Option<[f64; 2]>,
}

impl Line {
    /// The least-squares line of y on x; none where all x are equal or the slope is zero.
    pub(super) fn through(points: &[[f64; 2]]) -> Option<Self> {
        let n = points.len() as f64;
        let mean = |k: usize| points.iter().map(|point| point[k]).sum::<f64>() / n;
        let (mean_x, mean_y) = (mean(0), mean(1));
        let sum = |f: &dyn Fn(f64, f64) -> f64| {
            points
                .iter()
                .map(|[x, y]| f(x - mean_x, y - mean_y))
                .sum::<f64>()
        };
        let sxx = sum(&|x, _| x * x);
        let slope = sum(&|x, y| x * y) / sxx;
        if !slope.is_finite() || slope == 0.0 {
            return None;
        }
        let standard_errors = (points.len() > 2).then(|| {
            let variance = sum(&|x, y| (y - slope * x).powi(2)) / (n - 2.0);
            let to_mean = mean_y / slope;
            [
                (variance / sxx).sqrt(),
                (variance * (1.0 / n + to_mean * to_mean / sxx)).sqrt() / slope.abs(),
            ]
        });
        Some(Self {
            slope,
            intercept: mean_x - mean_y / slope,
            standard_errors,
        })
    }
}

/// Coefficients of the polynomial of N − 1 degrees that is nearest to the points, constant first; none where the
/// points do not determine it. Arguments are best scaled to −1 to 1.
pub(super) fn polynomial<const N: usize>(points: &[[f64; 2]]) -> Option<[f64; N]> {
    if points.len() < N {
        return None;
    }
    let mut matrix = [[0.0; N]; N];
    let mut side = [0.0; N];
    for [x, y] in points {
        let powers: [f64; N] = std::array::from_fn(|k| x.powi(k as i32));
        for (row, a) in powers.iter().enumerate() {
            side[row] += a * y;
            for (column, b) in powers.iter().enumerate() {
                matrix[row][column] += a * b;
            }
        }
    }
    solve(matrix, side)
}

/// Solution of a linear system by elimination with row pivoting; none where it is singular to rounding.
fn solve<const N: usize>(mut matrix: [[f64; N]; N], mut side: [f64; N]) -> Option<[f64; N]> {
    let scale = matrix.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
    for column in 0..N {
        let pivot = (column..N).max_by(|a, b| {
            matrix[*a][column]
                .abs()
                .total_cmp(&matrix[*b][column].abs())
        })?;
        if matrix[pivot][column].abs() <= 1e-13 * scale {
            return None;
        }
        matrix.swap(column, pivot);
        side.swap(column, pivot);
        let top = matrix[column];
        for row in column + 1..N {
            let factor = matrix[row][column] / top[column];
            for (entry, above) in matrix[row].iter_mut().zip(top) {
                *entry -= factor * above;
            }
            side[row] -= factor * side[column];
        }
    }
    for row in (0..N).rev() {
        let known: f64 = (row + 1..N).map(|k| matrix[row][k] * side[k]).sum();
        side[row] = (side[row] - known) / matrix[row][row];
    }
    Some(side)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_the_errors_of_a_textbook() {
        // y = 2 (x − 1) with residuals 1, −2, 1 off the line: s² = 6, Sxx = 2.
        let line = Line::through(&[[1.0, 1.0], [2.0, 0.0], [3.0, 5.0]]).unwrap();
        assert!((line.slope - 2.0).abs() < 1e-12 && (line.intercept - 1.0).abs() < 1e-12);
        let [slope, intercept] = line.standard_errors.unwrap();
        assert!((slope - 3.0f64.sqrt()).abs() < 1e-12, "{slope}");
        assert!((intercept - (6.0 * (1.0 / 3.0 + 0.5) / 4.0f64).sqrt()).abs() < 1e-12);
        assert_eq!(Line::through(&[[1.0, 1.0], [1.0, 2.0]]), None);
    }

    #[test]
    fn a_polynomial_comes_back() {
        let truth = [1.0, -2.0, 0.5, 3.0, -1.0, 0.25];
        let at = |x: f64| truth.iter().rev().fold(0.0, |sum, c| sum * x + c);
        let points: Vec<_> = (-10..=10)
            .map(|k| f64::from(k) / 10.0)
            .map(|x| [x, at(x)])
            .collect();
        let found: [f64; 6] = polynomial(&points).unwrap();
        for (a, b) in found.iter().zip(truth) {
            assert!((a - b).abs() < 1e-9, "{found:?}");
        }
        assert_eq!(polynomial::<6>(&points[..5]), None);
    }
}
