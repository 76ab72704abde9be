//! The machine that a command runs on.

use crate::mission::run_json::Machine;

/// Finds out about this machine; what cannot be found stays empty.
pub fn this_machine() -> Machine {
    Machine {
        platform: format!("{}-{}", std::env::consts::OS, std::env::consts::ARCH),
        processor: processor().unwrap_or_default(),
        cores: std::thread::available_parallelism().map_or(1, usize::from),
    }
}

fn processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name") || line.starts_with("Model"))?;
    line.split_once(':').map(|(_, name)| name.trim().to_owned())
}
