//! The socket of `lookout stream --serve`.

use crate::key::Reload;
use crate::table::table;

table! {
    /// Results as lines of JSON on a Unix socket, for programs of other users: `lookout stream --serve`
    /// (docs/outputs.md).
    pub struct Stream, reload: Reload::OtherProcess;

    /// Path of the socket, in a folder that only root or this user can write. If empty, there is none.
    socket: Path = "";

    /// Who may connect, as the mode of the file: its owner, also its group, or everybody on the machine. To connect is
    /// to read; nothing can be sent.
    mode: Choice(&["0600", "0660", "0666"]) = "0660";

    /// Group of the file, by name or number; this process must be a member. If empty, its own group.
    group: Text(32) = "";
}
