use std::process::ExitCode;

fn main() -> ExitCode {
    overfly::cli::run(std::env::args_os())
}
