//! Progress on the terminal; nothing where standard error is none.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use overfly_client::{ProgressNote, Stage};

use super::answer::Form;
use crate::planner::Progress;

/// The planner speaks far more often than anybody can read.
const REDRAW: Duration = Duration::from_millis(50);
const SPINNER: &str = "{spinner} {msg} {elapsed}";
const SEARCH: &str = "{spinner} search   [{bar:30}] {pos}/{len} iterations, {msg}";

/// A line that shows how far the work has come; it vanishes at the end.
pub struct Meter {
    bar: ProgressBar,
    is_searching: bool,
    shown: Option<Instant>,
    asked: Option<u32>,
}

impl Meter {
    pub fn new(form: Form) -> Self {
        let target = if form.shows_progress() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(None, target);
        bar.set_style(style(SPINNER));
        Self { bar, is_searching: false, shown: None, asked: None }
    }

    /// Lets the time run on while nothing is reported: for stages that take seconds.
    pub fn keep_moving(&self) {
        if !self.bar.is_hidden() {
            self.bar.enable_steady_tick(2 * REDRAW);
        }
    }

    /// Work whose length is not known has begun.
    pub fn stage(&mut self, name: &str) {
        if self.is_searching {
            self.bar.set_style(style(SPINNER));
            self.is_searching = false;
        }
        self.bar.set_message(name.to_owned());
        self.bar.tick();
    }

    /// Iterations that the search was to make, as soon as it has spoken.
    pub fn asked(&self) -> Option<u32> {
        self.asked
    }

    /// A word of the in-process planner.
    pub fn search(&mut self, progress: &Progress) {
        self.show_search(progress.iteration, progress.iterations, progress.coverage_percent, progress.length_m);
    }

    /// A word of the daemon.
    pub fn note(&mut self, note: &ProgressNote) {
        match note.stage {
            Stage::Read => self.stage("reading the scene"),
            Stage::Survey => self.stage("sampling the surface"),
            Stage::Field => self.stage("casting the rays of the field"),
            Stage::Search => self.show_search(note.iteration, note.iterations, note.coverage_percent, note.length_m),
        }
    }

    fn show_search(&mut self, iteration: u32, iterations: u32, coverage_percent: f64, length_m: f64) {
        self.asked = Some(iterations);
        if self.bar.is_hidden() || self.shown.is_some_and(|shown| shown.elapsed() < REDRAW) {
            return;
        }
        self.shown = Some(Instant::now());
        if !self.is_searching {
            self.bar.set_style(style(SEARCH));
            self.is_searching = true;
        }
        self.bar.set_length(u64::from(iterations));
        self.bar.set_position(u64::from(iteration));
        self.bar.set_message(format!("{coverage_percent:.1} % of capturable, {length_m:.0} m"));
    }
}

impl Drop for Meter {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).expect("the templates are fixed").progress_chars("━╸ ")
}
