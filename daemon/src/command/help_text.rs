//! Texts of `--help` fill the width of the terminal: a source line that is a little longer than that would leave single
//! words on lines of their own.

use clap::Command;

/// The command line with the paragraphs below the options, and those of all subcommands, as single lines, which are then
/// wrapped.
pub fn reflowed(mut command: Command) -> Command {
    if let Some(text) = command.get_after_help() {
        let text = paragraphs(&text.to_string());
        command = command.after_help(text);
    }
    let names: Vec<String> = command.get_subcommands().map(|sub| sub.get_name().to_owned()).collect();
    for name in names {
        command = command.mut_subcommand(name, reflowed);
    }
    command
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
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::command::Cli;
    use clap::CommandFactory;

    #[test]
    fn paragraphs_become_lines_and_examples_stay() {
        let text = "Examples:\n  a  b\n  c\n\nOne\ntwo.\nThree\n\nFour:\nfive";
        assert_eq!(paragraphs(text), "Examples:\n  a  b\n  c\n\nOne two. Three\n\nFour:\nfive");
    }

    fn check(command: &Command, width: usize) {
        let mut own = command.clone().term_width(width).disable_help_subcommand(true);
        let help = own.render_help().to_string();
        let lines: Vec<&str> = help.lines().skip_while(|line| !line.starts_with("Examples:")).collect();
        for pair in lines.windows(2) {
            let is_text = |line: &str| !line.is_empty() && !line.starts_with(' ') && !line.ends_with(':');
            let word = pair[1].split_whitespace().next().unwrap_or_default();
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

    #[test]
    fn no_line_of_any_help_ends_early() {
        for width in [60, 80, 100] {
            check(&reflowed(Cli::command()), width);
        }
    }
}
