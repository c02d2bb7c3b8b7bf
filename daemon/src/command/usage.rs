//! The end of a command line that is help or an error of usage, with what the parser cannot know.

use super::help_text::printed;
use clap::Error;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use std::io::Write;
use std::path::Path;
use std::process::exit;

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

/// The error, with the likely cause where an argument too many is a file: the shell has replaced a pattern by its files.
fn explained(mut error: Error) -> Error {
    let names = |kind: ContextKind, part: &str| match error.get(kind) {
        Some(ContextValue::String(name)) => name.contains(part),
        Some(ContextValue::Strings(names)) => names.iter().any(|name| name.contains(part)),
        _ => false,
    };
    let is_file = match error.get(ContextKind::InvalidArg) {
        Some(ContextValue::String(name)) => Path::new(name).is_file(),
        _ => false,
    };
    let is_pattern = match error.kind() {
        ErrorKind::UnknownArgument => is_file,
        // The second file of a pattern counts as a path.
        ErrorKind::ArgumentConflict => {
            let kinds = [ContextKind::InvalidArg, ContextKind::PriorArg];
            kinds.iter().any(|kind| names(*kind, "<PATTERN>"))
                && kinds.iter().any(|kind| names(*kind, "[PATH]"))
        }
        _ => false,
    };
    if is_pattern {
        let tip = "if a pattern with * or ? was meant, put it in quotes, such as 'cam0/*.png': the shell replaces it by its files";
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip.into()]));
    }
    error
}
