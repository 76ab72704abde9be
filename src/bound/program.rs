//! Linear programs with whole coefficients, the bound that any multipliers certify, and the solver that finds good ones.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT};

use crate::settings::BoundSettings;

/// Minimise `costs` times x subject to the rows and 0 <= x <= `upper`.
#[derive(Clone, Debug, Default)]
pub struct Program {
    /// Whole units of length.
    pub costs: Vec<i64>,
    pub upper: Vec<i64>,
    pub rows: Vec<Row>,
}

/// A row: the sum of its terms is at least `at_least`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Row {
    /// Variable and coefficient.
    pub terms: Vec<(usize, i64)>,
    pub at_least: i64,
}

/// What the solver found. It need not be right: it guides the search for rows, and its multipliers are only a proposal.
#[derive(Clone, Debug)]
pub struct Proposal {
    pub values: Vec<f64>,
    /// By row, at least 0 if they are any good.
    pub multipliers: Vec<f64>,
}

/// What multipliers prove.
#[derive(Clone, Debug)]
pub struct Certificate {
    /// No solution costs less, in the units of the costs.
    pub bound: i64,
    /// Costs that the rows leave to each variable, in units of 2^-[`FRACTION_BITS`].
    pub reduced: Vec<i128>,
}

/// Multipliers are rounded to so many binary digits after the point.
pub const FRACTION_BITS: u32 = 20;

/// Multipliers are cut off here, so that no sum can overflow.
const MOST_MULTIPLIER: f64 = 1e13;

/// The solver works in units of so many of the costs.
const UNIT: f64 = 1e6;

impl Row {
    /// How far the row is from being kept, in its own units; negative when it is kept with room.
    pub fn violation(&self, values: &[f64]) -> f64 {
        self.at_least as f64 - self.terms.iter().map(|&(j, a)| a as f64 * values[j]).sum::<f64>()
    }
}

impl Program {
    /// Weak duality in whole numbers: for any multipliers l >= 0 and any solution x,
    /// c x >= l b + (c - l A) x >= l b + sum over j of min(0, (c - l A)_j) upper_j. Rounding the multipliers changes how good the bound is, not
    /// that it holds.
    pub fn certify(&self, multipliers: &[f64]) -> Certificate {
        let mut total: i128 = 0;
        let mut reduced: Vec<i128> = self.costs.iter().map(|&cost| i128::from(cost) << FRACTION_BITS).collect();
        for (row, &multiplier) in self.rows.iter().zip(multipliers) {
            let multiplier = fixed(multiplier);
            total += multiplier * i128::from(row.at_least);
            row.terms.iter().for_each(|&(j, a)| reduced[j] -= multiplier * i128::from(a));
        }
        total += reduced.iter().zip(&self.upper).map(|(&left, &upper)| left.min(0) * i128::from(upper)).sum::<i128>();
        // An absurd proposal may prove less than nothing, but never more than it should.
        let bound = (total >> FRACTION_BITS).clamp(i128::from(i64::MIN), i128::from(i64::MAX)) as i64;
        Certificate { bound, reduced }
    }

    /// Solves the program in the variables that are `active`, the others being 0.
    pub fn solve(&self, active: &[bool], settings: &BoundSettings) -> Proposal {
        let variables: Vec<usize> = (0..self.costs.len()).filter(|&j| active[j]).collect();
        let mut place = vec![usize::MAX; self.costs.len()];
        variables.iter().enumerate().for_each(|(k, &j)| place[j] = k);
        let (n, m) = (variables.len(), self.rows.len());
        let (mut at_row, mut at_column, mut entries) = (Vec::new(), Vec::new(), Vec::new());
        let mut push = |row: usize, column: usize, entry: f64| {
            at_row.push(row);
            at_column.push(column);
            entries.push(entry);
        };
        let mut right: Vec<f64> = Vec::with_capacity(m + 2 * n);
        for (r, row) in self.rows.iter().enumerate() {
            let scale = row.terms.iter().map(|term| term.1.abs()).max().unwrap_or(1).max(1) as f64;
            row.terms.iter().filter(|term| active[term.0]).for_each(|&(j, a)| push(r, place[j], -a as f64 / scale));
            right.push(-row.at_least as f64 / scale);
        }
        for k in 0..n {
            push(m + k, k, -1.0);
            push(m + n + k, k, 1.0);
        }
        right.extend(std::iter::repeat_n(0.0, n));
        right.extend(variables.iter().map(|&j| self.upper[j] as f64));

        let costs: Vec<f64> = variables.iter().map(|&j| self.costs[j] as f64 / UNIT).collect();
        let rows = CscMatrix::new_from_triplets(m + 2 * n, n, at_row, at_column, entries);
        let settings = DefaultSettings {
            verbose: false,
            max_iter: settings.solver_iterations,
            tol_gap_rel: settings.solver_gap,
            tol_feas: settings.solver_feasibility,
            ..Default::default()
        };
        let cones = [NonnegativeConeT(m + 2 * n)];
        let mut values = vec![0.0; self.costs.len()];
        let mut multipliers = vec![0.0; m];
        if let Ok(mut solver) = DefaultSolver::new(&CscMatrix::zeros((n, n)), &costs, &rows, &right, &cones, settings) {
            solver.solve();
            variables.iter().zip(&solver.solution.x).for_each(|(&j, &x)| values[j] = x.clamp(0.0, self.upper[j] as f64));
            for ((found, row), z) in multipliers.iter_mut().zip(&self.rows).zip(&solver.solution.z) {
                let scale = row.terms.iter().map(|term| term.1.abs()).max().unwrap_or(1).max(1) as f64;
                *found = z * UNIT / scale;
            }
        }
        Proposal { values, multipliers }
    }
}

fn fixed(multiplier: f64) -> i128 {
    if !multiplier.is_finite() {
        return 0;
    }
    (multiplier.clamp(0.0, MOST_MULTIPLIER) * f64::from(1u32 << FRACTION_BITS)) as i128
}
