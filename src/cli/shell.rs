//! `overfly completions` and `overfly man`: the command line told to shells and to `man`.

use std::io;
use std::path::{Path, PathBuf};

use clap::{Command, CommandFactory};
use serde_json::json;

use super::answer::Answer;
use super::arguments::{Arguments, CompletionsArgs, ManArgs};
use super::failure::Failure;
use super::outputs::Folder;

pub fn completions(arguments: &CompletionsArgs) -> Result<Answer, Failure> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut Arguments::command(), "overfly", &mut script);
    let text = String::from_utf8_lossy(&script).into_owned();
    let json = json!({ "shell": arguments.shell.to_string(), "script": text });
    Ok(Answer { text, json })
}

pub fn man(arguments: &ManArgs) -> Result<Answer, Failure> {
    let mut program = Arguments::command().disable_help_subcommand(true);
    // Commands know their full names only then, and the options that all of them have.
    program.build();
    match &arguments.out {
        Some(folder) => write_pages(&program, folder),
        None => {
            let page = page(find(&program, &arguments.command)?)?;
            Ok(Answer { json: json!({ "page": page }), text: page })
        }
    }
}

fn find<'c>(program: &'c Command, words: &[String]) -> Result<&'c Command, Failure> {
    words.iter().try_fold(program, |command, word| {
        command.find_subcommand(word).ok_or_else(|| {
            Failure::Usage(format!(
                "there is no command {word:?}; `overfly --help` lists them all, `overfly COMMAND --help` those within one"
            ))
        })
    })
}

fn write_pages(program: &Command, folder: &Path) -> Result<Answer, Failure> {
    let _folder = Folder::prepare(folder)?;
    let mut files = Vec::new();
    write_page(program, folder, &mut files)?;
    let text = format!("wrote {} manual pages into {}", files.len(), folder.display());
    Ok(Answer { text, json: json!({ "files": files }) })
}

fn write_page(command: &Command, folder: &Path, files: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let path = folder.join(format!("{}.1", title(command)));
    std::fs::write(&path, page(command)?).map_err(|cause| Failure::write(&path, cause))?;
    files.push(path);
    command.get_subcommands().try_for_each(|within| write_page(within, folder, files))
}

/// What a page is called: `overfly-plan` of the command `overfly plan`.
fn title(command: &Command) -> String {
    command.get_display_name().unwrap_or(command.get_name()).to_owned()
}

fn page(command: &Command) -> Result<String, Failure> {
    let mut page = Vec::new();
    let rendered: io::Result<()> = clap_mangen::Man::new(command.clone()).title(title(command)).render(&mut page);
    rendered.map_err(|cause| Failure::Unexpected(format!("the page of {} cannot be made: {cause}", command.get_name())))?;
    Ok(String::from_utf8_lossy(&page).into_owned())
}

#[cfg(test)]
mod tests {
    use clap::ValueEnum;
    use clap_complete::Shell;

    use super::*;

    /// The names of all commands, without those that are hidden.
    fn names() -> Vec<String> {
        Arguments::command().get_subcommands().map(|command| command.get_name().to_owned()).collect()
    }

    #[test]
    fn every_shell_learns_every_command_and_its_options() {
        assert!(names().len() > 20);
        for &shell in Shell::value_variants() {
            let text = completions(&CompletionsArgs { shell }).unwrap().text;
            for name in names() {
                assert!(text.contains(&name), "{shell}: {name}");
            }
            for option in ["time-left", "no-wait", "until-stdin-ends"] {
                assert!(text.contains(option), "{shell}: {option}");
            }
        }
    }

    #[test]
    fn each_command_has_a_page_with_its_options_and_examples() {
        let folder = tempfile::tempdir().unwrap();
        let man_of = |command: &[&str], out: Option<PathBuf>| {
            man(&ManArgs { command: command.iter().map(|word| (*word).to_owned()).collect(), out })
        };
        man_of(&[], Some(folder.path().join("man1"))).unwrap();
        for name in names() {
            let page = std::fs::read_to_string(folder.path().join(format!("man1/overfly-{name}.1"))).unwrap();
            assert!(page.contains(&format!(".TH overfly-{name} 1")), "{name}: {}", &page[..200]);
            assert!(page.contains("\\-\\-json"), "{name} has the options of all commands");
            assert_eq!(man_of(&[&name], None).unwrap().text, page);
        }
        let page = man_of(&["edit", "raise"], None).unwrap().text;
        assert!(page.contains("overfly\\-edit\\-raise") || page.contains("overfly-edit-raise"), "{page}");
        assert!(page.contains("\\-\\-by"), "{page}");
        assert!(std::fs::read_to_string(folder.path().join("man1/overfly.1")).unwrap().contains("Exit codes"));
        let refused = man_of(&["fry"], None).unwrap_err();
        assert!(refused.to_string().contains("\"fry\"") && refused.kind() == crate::cli::failure::Kind::Usage, "{refused}");
    }
}
