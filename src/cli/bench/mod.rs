//! `overfly bench`: what this machine does, beside what a prototype reached.

mod field;
mod ipc;
mod replan;
mod search;
mod warm;

use std::sync::Arc;

use serde_json::{Value, json};

use super::answer::{self, Answer, Form};
use super::arguments::{BenchArgs, Subject};
use super::failure::Failure;
use super::machine::this_machine;
use super::{rig_file, settings_file};
use crate::camera::Rig;
use crate::settings::Settings;

pub fn run(arguments: &BenchArgs, form: Form) -> Result<Answer, Failure> {
    let report = match arguments.subject {
        Subject::Field => field::run(arguments, form)?,
        Subject::Search => search::run(arguments, form)?,
        Subject::Ipc => ipc::run(arguments, form)?,
        Subject::Replan => replan::run(arguments, form)?,
        Subject::Warm => warm::run(arguments, form)?,
    };
    Ok(report.answer())
}

/// The rig that is measured with, and the settings for its sight.
fn given(arguments: &BenchArgs) -> Result<(Rig, Arc<Settings>), Failure> {
    let rig = rig_file::read(&arguments.rig)?.rig;
    let settings = settings_file::settings(arguments.config.as_ref(), Some(&arguments.sizes))?.with_sight(rig.sight_scale());
    settings.check()?;
    Ok((rig, Arc::new(settings)))
}

/// What was measured, on what.
struct Report {
    /// Facts of the scene and of the results, in order.
    facts: Vec<(&'static str, Value)>,
    rows: Vec<Row>,
    /// What programs look for by name.
    figures: Vec<(&'static str, Value)>,
}

/// One measured step.
struct Row {
    step: &'static str,
    unit: &'static str,
    /// Measured values in `unit`, in the order of measurement.
    values: Vec<f64>,
    /// What a prototype reached on two cores of a server processor, in words.
    limit: &'static str,
}

impl Report {
    fn answer(&self) -> Answer {
        let machine = this_machine();
        let mut rows =
            vec![["step", "median", "p99", "spread", "unit", "limit (prototype, two cores)"].map(str::to_owned).to_vec()];
        rows.extend(self.rows.iter().map(Row::cells));
        let facts: Vec<String> = self.facts.iter().map(|(name, value)| format!("{name} {}", shown(value))).collect();
        let text = format!(
            "{}, {} cores ({}); version {}\n{}\n\n{}",
            machine.processor,
            machine.cores,
            machine.platform,
            env!("CARGO_PKG_VERSION"),
            facts.join(", "),
            answer::table(&rows)
        );
        let facts: serde_json::Map<String, Value> =
            self.facts.iter().map(|(name, value)| (name.replace(' ', "_"), value.clone())).collect();
        let rows: Vec<Value> = self.rows.iter().map(Row::to_json).collect();
        let mut json = json!({ "machine": machine, "version": env!("CARGO_PKG_VERSION"), "facts": facts, "steps": rows });
        self.figures.iter().for_each(|(name, value)| json[*name] = value.clone());
        Answer { text, json }
    }
}

/// A fact as a person reads it: whole numbers as they are, others with one decimal.
fn shown(value: &Value) -> String {
    match value.as_f64().filter(|_| value.is_f64()) {
        Some(number) => format!("{number:.1}"),
        None => value.to_string(),
    }
}

impl Row {
    fn cells(&self) -> Vec<String> {
        let number = |value: f64| format!("{value:.3}");
        let (median, p99, spread) = (self.median(), self.quantile(0.99), self.quantile(0.9) - self.quantile(0.1));
        vec![self.step.into(), number(median), number(p99), number(spread), self.unit.into(), self.limit.into()]
    }

    fn to_json(&self) -> Value {
        json!({
            "step": self.step,
            "unit": self.unit,
            "median": self.median(),
            "p99": self.quantile(0.99),
            "max": self.quantile(1.0),
            "spread": self.quantile(0.9) - self.quantile(0.1),
            "repeats": self.values.len(),
            "limit": self.limit,
        })
    }

    fn median(&self) -> f64 {
        self.quantile(0.5)
    }

    fn quantile(&self, share: f64) -> f64 {
        quantile(&self.values, share)
    }
}

/// The nearest-rank quantile.
fn quantile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let rank = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied().unwrap_or(f64::NAN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_were_measured() {
        let row = Row { step: "", unit: "ms", values: vec![5.0, 1.0, 4.0, 2.0, 3.0], limit: "" };
        assert_eq!((row.median(), row.quantile(0.99), row.quantile(0.1)), (3.0, 5.0, 1.0));
    }
}
