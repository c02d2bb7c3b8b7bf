//! `lookout scene`: the text of a scene.

use crate::command::console::say;
use crate::command::error::CommandError;
use clap::Args;
use sources::scene::library;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout scene street > my.toml                  a start for one's own scene
  lookout scene 'random?seed=7' > seven.toml      what a seed generates
  lookout replay scene:seven.toml --out results";

#[derive(Args, Debug)]
pub struct SceneCommand {
    /// Name as in lookout replay scene:NAME, or a TOML file
    #[arg(value_name = "SCENE")]
    pub scene: String,
}

pub fn run(args: &SceneCommand) -> Result<(), CommandError> {
    let text = library::text(&args.scene)?;
    say(text.trim_end())
}
