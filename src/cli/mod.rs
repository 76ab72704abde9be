//! The command line. Commands are clients of the daemon, or run the planner in process; either way one writer makes the files.

mod answer;
mod arguments;
mod bench;
mod bound;
mod bounded_file;
mod browser;
mod daemon;
mod degrade;
mod demo;
mod demo_flight;
mod edit;
mod edit_orders;
mod en_route;
mod evaluate;
mod export;
mod failure;
mod first_look;
mod flown_scene;
mod fly;
mod generate;
mod import_lines;
mod in_process;
mod inspect;
mod interrupt;
mod live;
mod load;
mod machine;
mod outputs;
mod pages;
mod plan;
mod private_daemon;
mod progress;
mod received;
mod reproduce;
mod rig_file;
mod rigs;
mod scene;
mod serve;
mod settings_file;
mod shell;
mod shortfall;
mod status;
mod update;
mod values;
mod view;
mod watch;

use std::ffi::OsString;
use std::process::ExitCode;

use clap::Parser;

use self::answer::{Answer, Form};
use self::arguments::{Arguments, Command};
use self::failure::{Failure, Kind};

/// Runs the command line `line`, whose first word is the program's name.
pub fn run(line: impl IntoIterator<Item = OsString>) -> ExitCode {
    let line: Vec<OsString> = line.into_iter().collect();
    let arguments = match Arguments::try_parse_from(&line) {
        Ok(arguments) => arguments,
        Err(error) => return refuse_line(&line, &error),
    };
    let form = if arguments.json { Form::Json } else { Form::Text };
    match execute(&arguments.command, form) {
        Ok(answer) => match answer.map_or(Ok(()), |answer| form.print(&answer)) {
            Ok(()) => ExitCode::SUCCESS,
            // Standard output is what failed, so even scripts find this on standard error.
            Err(cause) => report(&Failure::Print(cause), Form::Text),
        },
        Err(failure) => report(&failure, form),
    }
}

/// Commands that speak while they run have nothing left to say at their end.
fn execute(command: &Command, form: Form) -> Result<Option<Answer>, Failure> {
    match command {
        Command::Demo(arguments) => demo::run(arguments, form).map(Some),
        Command::Inspect(arguments) => inspect::run(arguments, form).map(Some),
        Command::Serve(arguments) => serve::run(arguments).map(|()| None),
        Command::Load(arguments) => load::run(arguments, form).map(Some),
        Command::Plan(arguments) => plan::run(arguments, form).map(Some),
        Command::Evaluate(arguments) => evaluate::run(arguments, form).map(Some),
        Command::View(arguments) => view::run(arguments, form).map(Some),
        Command::Export(arguments) => export::run(arguments, form).map(Some),
        Command::Edit(arguments) => edit::run(arguments, form).map(Some),
        Command::Update(arguments) => update::run(arguments, form).map(Some),
        Command::Watch(arguments) => watch::run(arguments, form).map(|()| None),
        Command::Fly(arguments) => fly::run(arguments, form).map(|()| None),
        Command::Cancel(arguments) => scene::cancel(arguments).map(Some),
        Command::Unload(arguments) => scene::unload(arguments).map(Some),
        Command::Status(arguments) => status::run(arguments, form),
        Command::Reload(reach) => status::reload(reach).map(Some),
        Command::Stop(reach) => status::stop(reach).map(Some),
        Command::Bench(arguments) => bench::run(arguments, form).map(Some),
        Command::Bound(arguments) => bound::run(arguments, form).map(Some),
        Command::Generate(arguments) => generate::run(arguments, form).map(Some),
        Command::Degrade(arguments) => degrade::run(arguments, form).map(Some),
        Command::Reproduce(arguments) => reproduce::run(arguments, form).map(Some),
        Command::Rigs(arguments) => rigs::run(arguments).map(Some),
        Command::Completions(arguments) => shell::completions(arguments).map(Some),
        Command::Man(arguments) => shell::man(arguments).map(Some),
    }
}

fn report(failure: &Failure, form: Form) -> ExitCode {
    match form {
        Form::Json => {
            if let Err(cause) = form.print(&Answer { text: String::new(), json: failure.to_json() }) {
                eprintln!("overfly: {failure}; and this cannot be printed on standard output: {cause}");
            }
        }
        Form::Text => eprintln!("overfly: {failure}"),
    }
    ExitCode::from(failure.kind() as u8)
}

/// Help and version are answers; everything else is a mistake in the line.
fn refuse_line(line: &[OsString], error: &clap::Error) -> ExitCode {
    if !error.use_stderr() || !line.iter().any(|word| word == "--json") {
        let _ = error.print();
        return ExitCode::from(if error.use_stderr() { Kind::Usage as u8 } else { 0 });
    }
    let message = error.render().to_string().trim_end().to_owned();
    report(&Failure::Usage(message), Form::Json)
}
