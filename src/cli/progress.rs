//! Progress on the terminal; nothing where standard error is none.

use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use overfly_client::{ProgressNote, Stage};

use super::answer::Form;
use crate::planner::{Progress, StopToken};
use crate::stop::Part;

/// The planner speaks far more often than anybody can read.
const REDRAW: Duration = Duration::from_millis(50);
const SPINNER: &str = "{spinner} {msg} {elapsed}";
const BAR: &str = "{spinner} {prefix} [{bar:20}] {msg}";
/// Parts of a bar.
const PARTS: u64 = 1000;
/// Before so much of the work is done nobody knows how long the rest takes.
const LEAST_SHARE: f64 = 0.02;

/// A line that shows how far the work has come; it vanishes at the end.
pub struct Meter {
    bar: ProgressBar,
    /// What is counted at the moment.
    counted: Option<Counting>,
    shown: Option<Instant>,
    asked: Option<u32>,
    budget_s: Option<f64>,
}

/// A pass of a part of the work, how many steps of it are done, and when their counting began.
struct Counting {
    part: &'static str,
    done: u64,
    begun: Instant,
}

/// Steps of work.
#[derive(Clone, Copy)]
struct Steps {
    done: u64,
    of: u64,
    unit: &'static str,
}

impl Meter {
    pub fn new(form: Form) -> Self {
        Self::with_budget(form, None)
    }

    /// The same for a search that may take so many seconds: they tell sooner than its iterations how much is left.
    pub fn with_budget(form: Form, budget_s: Option<f64>) -> Self {
        let target = if form.shows_progress() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bar = ProgressBar::with_draw_target(None, target);
        bar.set_style(style(SPINNER));
        Self { bar, counted: None, shown: None, asked: None, budget_s }
    }

    /// Lets the time run on while nothing is reported: for stages that take seconds.
    pub fn keep_moving(&self) {
        if !self.bar.is_hidden() {
            self.bar.enable_steady_tick(2 * REDRAW);
        }
    }

    /// Says something while the line is shown.
    pub fn say(&self, form: Form, text: &str) {
        self.bar.suspend(|| form.remark(text));
    }

    /// Work whose length is not known has begun.
    pub fn stage(&mut self, name: &str) {
        if self.counted.take().is_some() {
            self.bar.set_style(style(SPINNER));
        }
        self.bar.set_message(name.to_owned());
        self.bar.tick();
    }

    /// A part of the work has begun whose steps are not counted yet, or are not shown.
    pub fn begin(&mut self, part: Part) {
        self.stage(match part {
            Part::Reading => "reading the scene",
            Part::Survey => "sampling the surface",
            Part::Rays => "casting the rays of the field",
        });
    }

    /// Iterations that the search was to make, as soon as it has spoken.
    pub fn asked(&self) -> Option<u32> {
        self.asked
    }

    /// Does work that counts its steps in `stop`, and shows them meanwhile.
    pub fn while_counting<T: Send>(&mut self, part: Part, stop: &StopToken, work: impl FnOnce() -> T + Send) -> T {
        stop.begin(part, 0);
        self.begin(part);
        if self.bar.is_hidden() {
            return work();
        }
        let (at_work, is_over) = mpsc::channel::<()>();
        std::thread::scope(|scope| {
            let working = scope.spawn(move || {
                let _at_work = at_work;
                work()
            });
            while is_over.recv_timeout(2 * REDRAW) == Err(RecvTimeoutError::Timeout) {
                let counted = stop.progress();
                self.show_part(counted.part, counted.told());
            }
            working.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        })
    }

    /// A word of the in-process planner.
    pub fn search(&mut self, progress: &Progress) {
        self.show_search(progress.iteration, progress.iterations, progress.coverage_percent, progress.length_m);
    }

    /// A word of the daemon.
    pub fn note(&mut self, note: &ProgressNote) {
        let part = match note.stage {
            Stage::Read => Part::Reading,
            Stage::Survey => Part::Survey,
            Stage::Field => Part::Rays,
            Stage::Search => return self.show_search(note.done, note.of, note.coverage_percent, note.length_m),
        };
        self.show_part(part, [note.done.into(), note.of.into()]);
    }

    fn show_part(&mut self, part: Part, [done, of]: [u64; 2]) {
        if of == 0 {
            return self.begin(part);
        }
        let (name, unit) = match part {
            Part::Reading => ("reading", "kB"),
            Part::Survey => ("survey", "parts"),
            Part::Rays => ("field", "viewpoints"),
        };
        self.show(name, Steps { done, of, unit }, "", None);
    }

    fn show_search(&mut self, done: u32, of: u32, coverage_percent: f64, length_m: f64) {
        self.asked = Some(of);
        let steps = Steps { done: done.into(), of: of.into(), unit: "iterations" };
        let found = format!(", {coverage_percent:.1} % of capturable, {length_m:.0} m");
        self.show("search", steps, &found, self.budget_s);
    }

    fn show(&mut self, part: &'static str, steps: Steps, found: &str, budget_s: Option<f64>) {
        let is_new = self.counted.as_mut().is_none_or(|counted| !counted.goes_on(part, steps.done));
        if self.bar.is_hidden() || !is_new && self.shown.is_some_and(|shown| shown.elapsed() < REDRAW) {
            return;
        }
        self.shown = Some(Instant::now());
        if is_new {
            self.bar.set_style(style(BAR));
            self.bar.set_prefix(part);
            self.bar.set_length(PARTS);
            self.counted = self.shown.map(|begun| Counting { part, done: steps.done, begun });
        }
        let elapsed_s = self.counted.as_ref().map_or(0.0, |counted| counted.begun.elapsed().as_secs_f64());
        let (share, words) = steps.told(elapsed_s, budget_s);
        self.bar.set_position((share * PARTS as f64) as u64);
        self.bar.set_message(words + found);
    }
}

impl Counting {
    /// Whether more steps of the same pass are done; each pass of a part begins with none.
    fn goes_on(&mut self, part: &str, done: u64) -> bool {
        let before = std::mem::replace(&mut self.done, done);
        self.part == part && before <= done
    }
}

impl Steps {
    /// The share that is done, and in words how much and how long the rest takes, after so many seconds; work with a budget of seconds ends with them.
    fn told(self, elapsed_s: f64, budget_s: Option<f64>) -> (f64, String) {
        let Self { done, of, unit } = self;
        let by_steps = if of == 0 { 0.0 } else { (done as f64 / of as f64).min(1.0) };
        let (share, left_s) = match budget_s {
            Some(budget_s) => ((elapsed_s / budget_s).clamp(by_steps, 1.0), Some((budget_s - elapsed_s).max(0.0))),
            None => (by_steps, (by_steps > LEAST_SHARE).then(|| elapsed_s * (1.0 - by_steps) / by_steps)),
        };
        // How many iterations fit into a budget is not known at first.
        let all = if of == u64::from(u32::MAX) { String::new() } else { format!("/{of}") };
        let left = left_s.map_or(String::new(), |left_s| format!(", {} left", duration(left_s)));
        (share, format!("{done}{all} {unit}{left}"))
    }
}

/// A time as it is read at a glance.
fn duration(seconds: f64) -> String {
    let whole = seconds.ceil() as u64;
    match whole {
        0..=99 => format!("{whole} s"),
        100..=5999 => format!("{} min {} s", whole / 60, whole % 60),
        _ => format!("{} h {} min", whole / 3600, whole / 60 % 60),
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

#[cfg(test)]
mod tests {
    use super::*;

    fn told(done: u64, of: u64, elapsed_s: f64, budget_s: Option<f64>) -> (f64, String) {
        Steps { done, of, unit: "iterations" }.told(elapsed_s, budget_s)
    }

    #[test]
    fn what_is_left_follows_from_what_was_done() {
        assert_eq!(told(1, 400, 3.0, None), (0.0025, "1/400 iterations".into()));
        assert_eq!(told(100, 400, 3.0, None), (0.25, "100/400 iterations, 9 s left".into()));
        assert_eq!(told(400, 400, 9.0, None), (1.0, "400/400 iterations, 0 s left".into()));
        assert_eq!(told(0, 0, 1.0, None), (0.0, "0/0 iterations".into()));
    }

    #[test]
    fn a_budget_ends_when_its_seconds_do() {
        let unknown = u64::from(u32::MAX);
        assert_eq!(told(12, unknown, 2.5, Some(10.0)), (0.25, "12 iterations, 8 s left".into()));
        assert_eq!(told(90, 100, 6.0, Some(10.0)), (0.9, "90/100 iterations, 4 s left".into()));
        assert_eq!(told(99, 100, 11.0, Some(10.0)), (1.0, "99/100 iterations, 0 s left".into()));
    }

    #[test]
    fn a_new_pass_is_told_from_the_one_before() {
        let mut counting = Counting { part: "survey", done: 3, begun: Instant::now() };
        assert_eq!([5, 5, 7].map(|done| counting.goes_on("survey", done)), [true; 3]);
        assert!(!counting.goes_on("survey", 1), "it has begun anew");
        assert!(counting.goes_on("survey", 2) && !counting.goes_on("field", 2));
    }

    #[test]
    fn times_are_told_at_a_glance() {
        assert_eq!([0.2, 99.0, 99.5, 3700.0, 7300.0].map(duration), ["1 s", "99 s", "1 min 40 s", "61 min 40 s", "2 h 1 min"]);
    }
}
