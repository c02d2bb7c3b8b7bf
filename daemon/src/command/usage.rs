//! The end of a command line that is help or an error of usage, with what the parser cannot know.

use super::Cli;
use super::help_text::printed;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, Error};
use sources::picture::ENDINGS;
use std::io::Write;
use std::path::Path;
use std::process::exit;

/// What to do about a pattern that the shell replaced.
const PATTERN_TIP: &str = "if a pattern with * or ? was meant, put it in quotes, such as 'cam0/*.png': the shell replaces it by \
                           its files";

/// Prints help or an error, and ends the process.
pub fn end(error: Error) -> ! {
    let error = explained(error);
    let text = printed(&error.render().to_string());
    let to_stderr = error.use_stderr();
    // A closed pipe is no error of the user's.
    let _ = if to_stderr {
        std::io::stderr().write_all(text.as_bytes())
    } else {
        std::io::stdout().write_all(text.as_bytes())
    };
    exit(error.exit_code())
}

/// The error, with the likely cause of an argument too many: the shell has replaced a pattern by its files, or a
/// configuration is given without its option.
fn explained(mut error: Error) -> Error {
    let arguments: Vec<String> =
        std::env::args_os().skip(1).map(|argument| argument.to_string_lossy().into_owned()).collect();
    let names = |kind: ContextKind, part: &str| match error.get(kind) {
        Some(ContextValue::String(name)) => name.contains(part),
        Some(ContextValue::Strings(names)) => names.iter().any(|name| name.contains(part)),
        _ => false,
    };
    let unknown = match (error.kind(), error.get(ContextKind::InvalidArg)) {
        (ErrorKind::UnknownArgument, Some(ContextValue::String(name))) => Some(name.clone()),
        _ => None,
    };
    // The second file of a pattern counts as a path.
    let is_second_of_pattern = error.kind() == ErrorKind::ArgumentConflict && {
        let kinds = [ContextKind::InvalidArg, ContextKind::PriorArg];
        kinds.iter().any(|kind| names(*kind, "<PATTERN>")) && kinds.iter().any(|kind| names(*kind, "[PATH]"))
    };
    let tip = match unknown {
        Some(name) if name.ends_with(".toml") && takes_config(&arguments) => {
            format!("a configuration is given with -c: -c {name}")
        }
        Some(name) if is_picture(&name) && are_pictures_of_replay(&arguments) => PATTERN_TIP.to_owned(),
        _ if is_second_of_pattern => PATTERN_TIP.to_owned(),
        _ => return error,
    };
    error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
    error
}

/// Whether the named command has the option `-c`.
fn takes_config(arguments: &[String]) -> bool {
    let cli = Cli::command();
    let mut command = &cli;
    for argument in arguments {
        if let Some(named) = command.find_subcommand(argument) {
            command = named;
        }
    }
    command.get_arguments().any(|argument| argument.get_short() == Some('c'))
}

/// Whether several pictures are given to `lookout replay`.
fn are_pictures_of_replay(arguments: &[String]) -> bool {
    arguments.iter().any(|argument| argument == "replay")
        && arguments.iter().filter(|argument| is_picture(argument)).count() > 1
}

fn is_picture(name: &str) -> bool {
    let path = Path::new(name);
    let ending = path.extension().and_then(|ending| ending.to_str()).map(str::to_ascii_lowercase);
    ending.is_some_and(|ending| ENDINGS.contains(&&ending[..])) && path.is_file()
}
