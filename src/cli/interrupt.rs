//! Ctrl-C and SIGTERM while a search runs: the first one asks for the best plan so far, the second one ends the program at once.

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::iterator::{Handle, Signals};

use super::answer::Form;

/// Listens for as long as it lives.
pub struct Interrupts {
    handle: Option<Handle>,
}

impl Interrupts {
    /// Runs `stop` on the first signal: it ends a search with its best plan.
    pub fn first(form: Form, stop: impl FnOnce() + Send + 'static) -> Self {
        Self::announced(form, "stopping: the best plan so far follows; Ctrl-C again ends at once", stop)
    }

    /// Runs `stop` on the first signal and says what follows. Where no signals can be caught they keep their usual meaning.
    pub fn announced(form: Form, what_follows: &'static str, stop: impl FnOnce() + Send + 'static) -> Self {
        let Ok(mut signals) = Signals::new([SIGINT, SIGTERM]) else { return Self { handle: None } };
        let handle = signals.handle();
        std::thread::spawn(move || {
            let mut stop = Some(stop);
            for signal in signals.forever() {
                match stop.take() {
                    Some(stop) => {
                        form.remark(what_follows);
                        stop();
                    }
                    None => drop(signal_hook::low_level::emulate_default_handler(signal)),
                }
            }
        });
        Self { handle: Some(handle) }
    }
}

impl Drop for Interrupts {
    fn drop(&mut self) {
        // From here on a signal means what it usually means: what follows is short, and nobody would listen.
        if let Some(handle) = self.handle.take() {
            handle.close();
        }
    }
}
