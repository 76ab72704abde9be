//! What can be said of the command line's own comforts.

use std::path::PathBuf;

use clap::Args;
use clap_complete::Shell;

#[derive(Debug, Args)]
#[command(after_help = "Put it where your shell looks for completions.\n\nExamples:\n  \
    overfly completions bash > ~/.local/share/bash-completion/completions/overfly\n  \
    overfly completions zsh > ~/.zfunc/_overfly                # with `fpath+=~/.zfunc` before `compinit` in .zshrc\n  \
    overfly completions fish > ~/.config/fish/completions/overfly.fish")]
pub struct CompletionsArgs {
    /// The shell
    #[arg(value_enum)]
    pub shell: Shell,
}

#[derive(Debug, Args)]
#[command(
    after_help = "Commands within a command are told with it: `overfly man edit raise`.\n\nExamples:\n  overfly man plan | man -l -\n  \
    overfly man --out ~/.local/share/man/man1 && man overfly-plan"
)]
pub struct ManArgs {
    /// The command that the page is about [default: overfly as a whole]
    #[arg(value_name = "COMMAND", conflicts_with = "out")]
    pub command: Vec<String>,
    /// Folder for the pages of all commands, overfly.1, overfly-plan.1 and so on; it is created
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
}
