//! Texts of `--help` fill the width of the terminal: a source line that is a little longer than that would leave single
//! words on lines of their own.

use clap::Command;

/// Holds the last two words of a text together, so that no word stands on the last line alone. [`printed`] replaces it.
const TIE: char = '\u{a0}';

/// The command line with the paragraphs below the options, and those of all subcommands, as single lines, which are then
/// wrapped; no last line of a text has one word.
pub fn reflowed(mut command: Command) -> Command {
    if let Some(text) = command.get_after_help() {
        let text = paragraphs(&text.to_string());
        command = command.after_help(text);
    }
    if let Some(text) = command.get_about() {
        let text = tied(&text.to_string());
        command = command.about(text);
    }
    if let Some(text) = command.get_long_about() {
        let text = tied(&text.to_string());
        command = command.long_about(text);
    }
    command = command.mut_args(|mut arg| {
        if let Some(text) = arg.get_help() {
            let text = tied(&text.to_string());
            arg = arg.help(text);
        }
        if let Some(text) = arg.get_long_help() {
            let text = tied(&text.to_string());
            arg = arg.long_help(text);
        }
        arg
    });
    let names: Vec<String> = command.get_subcommands().map(|sub| sub.get_name().to_owned()).collect();
    for name in names {
        command = command.mut_subcommand(name, reflowed);
    }
    command
}

/// A text of [`reflowed`] as it is printed.
pub fn printed(text: &str) -> String {
    text.replace(TIE, " ")
}

/// The text with the last two words of each line tied.
fn tied(text: &str) -> String {
    let line = |line: &str| match line.trim_end().rsplit_once(' ') {
        Some((before, last)) if !line.starts_with(' ') && !before.is_empty() => {
            format!("{before}{TIE}{last}")
        }
        _ => line.to_owned(),
    };
    text.split('\n').map(line).collect::<Vec<_>>().join("\n")
}

/// Joins the lines of each paragraph. Indented lines, such as examples, stay as they are.
fn paragraphs(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    // Whether the line before may be continued.
    let mut is_open = false;
    for line in text.lines() {
        let is_text = !line.is_empty() && !line.starts_with(' ');
        if !out.is_empty() {
            out.push(if is_open && is_text { ' ' } else { '\n' });
        }
        out.push_str(line);
        is_open = is_text && !line.ends_with(':');
    }
    tied(&out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command::Cli;
    use clap::CommandFactory;

    #[test]
    fn paragraphs_become_lines_and_examples_stay() {
        let text = "Examples:\n  a  b\n  c\n\nOne\ntwo.\nThree\n\nFour:\nfive";
        let expected = "Examples:\n  a  b\n  c\n\nOne two. Three\n\nFour:\nfive";
        assert_eq!(printed(&paragraphs(text)), expected);
        assert_eq!(tied("One two three"), "One two\u{a0}three");
    }

    fn check(command: &Command, width: usize) {
        let mut own = command.clone().term_width(width).disable_help_subcommand(true);
        let help = own.render_help().to_string();
        let lines: Vec<&str> = help.lines().skip_while(|line| !line.starts_with("Examples:")).collect();
        for pair in lines.windows(2) {
            let is_text = |line: &str| !line.is_empty() && !line.starts_with(' ') && !line.ends_with(':');
            let word = pair[1].split(' ').next().unwrap_or_default();
            let has_room = pair[0].chars().count() + 1 + word.chars().count() <= width;
            assert!(
                !(is_text(pair[0]) && is_text(pair[1]) && has_room),
                "{} at {width}: \"{}\" ends before \"{word}\"",
                command.get_name(),
                pair[0]
            );
        }
        command.get_subcommands().for_each(|sub| check(sub, width));
    }

    /// Words that stand alone on the last line of a text.
    fn orphans(command: &Command, width: usize, found: &mut Vec<String>) {
        let mut own = command.clone().term_width(width).disable_help_subcommand(true);
        // As --help chooses.
        let is_long = |arg: &clap::Arg| {
            arg.get_long_help().is_some()
                || arg.get_possible_values().iter().any(|value| value.get_help().is_some())
        };
        let is_long = command.get_long_about().is_some() || command.get_arguments().any(is_long);
        let help = if is_long { own.render_long_help() } else { own.render_help() };
        let help = printed(&help.to_string());
        let lines: Vec<&str> = help.lines().collect();
        let indent = |line: &str| line.len() - line.trim_start().len();
        for (i, pair) in lines.windows(2).enumerate() {
            let next = lines.get(i + 2).copied().unwrap_or_default();
            let is_last = next.trim().is_empty() || indent(next) != indent(pair[1]);
            let is_alone =
                pair[1].split_whitespace().count() == 1 && !pair[1].trim().starts_with(['-', '<', '[']);
            // A full line before it: else it is a name, or a text of its own.
            if is_alone && is_last && pair[0].len() + 25 > width {
                found.push(format!(
                    "{}: \"{}\" after \"{}\"",
                    command.get_name(),
                    pair[1].trim(),
                    pair[0].trim()
                ));
            }
        }
        command.get_subcommands().for_each(|sub| orphans(sub, width, found));
    }

    #[test]
    fn a_default_that_a_text_names_is_the_default() {
        let command = Cli::command();
        let record = command.find_subcommand("record").expect("a subcommand");
        let topics = record.get_arguments().find(|arg| arg.get_id() == "topics").expect("an option");
        let default = topics.get_default_values()[0].to_string_lossy().into_owned();
        let help = topics.get_help().map(ToString::to_string).unwrap_or_default();
        assert!(help.contains(&format!("[default: {default}]")), "{help}: {default}");
    }

    #[test]
    fn no_word_stands_alone_on_the_last_line() {
        let mut found = Vec::new();
        orphans(&reflowed(Cli::command()), 80, &mut found);
        assert!(found.is_empty(), "{found:#?}");
    }

    #[test]
    fn no_line_of_any_help_ends_early() {
        for width in [60, 80, 100] {
            check(&reflowed(Cli::command()), width);
        }
    }
}
