use std::path::PathBuf;
use std::process::ExitCode;

/// `overfly serve [--domain NAME] [--config FILE]`
fn main() -> ExitCode {
    tracing_subscriber::fmt()
        .with_env_filter(tracing_subscriber::EnvFilter::try_from_default_env().unwrap_or_else(|_| "info".into()))
        .with_writer(std::io::stderr)
        .init();
    match serve() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("overfly: {error}");
            ExitCode::FAILURE
        }
    }
}

fn serve() -> Result<(), Box<dyn std::error::Error>> {
    let (mut domain, mut config) = (None, None::<PathBuf>);
    let mut arguments = std::env::args().skip(2);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--domain" => domain = arguments.next(),
            "--config" => config = arguments.next().map(PathBuf::from),
            other => return Err(format!("unknown argument {other:?}").into()),
        }
    }
    let settings = match &config {
        Some(path) => overfly::daemon::read_configuration(path)?,
        None => overfly::settings::Settings::default(),
    };
    let domain = overfly_client::Domain::new(domain.as_deref().unwrap_or(&settings.daemon.domain))?;
    overfly::daemon::serve(settings, config, &domain)?;
    Ok(())
}
