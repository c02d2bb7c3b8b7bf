//! Markdown tables with aligned columns.

/// A table with a header; all columns but the first are right-aligned.
pub fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let width = |i: usize| {
        let cells = rows.iter().filter_map(|row| row.get(i)).map(|cell| cell.chars().count());
        cells.chain([head[i].chars().count(), 3]).max().unwrap_or(3)
    };
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let mut out = String::new();
    let mut line = |cells: Vec<String>| {
        out.push('|');
        for (i, (cell, width)) in cells.iter().zip(&widths).enumerate() {
            let gap = " ".repeat(width - cell.chars().count());
            out.push_str(&if i == 0 { format!(" {cell}{gap} |") } else { format!(" {gap}{cell} |") });
        }
        out.push('\n');
    };
    line(head.iter().map(ToString::to_string).collect());
    let rule =
        |(i, width): (usize, &usize)| "-".repeat(width - usize::from(i > 0)) + if i > 0 { ":" } else { "" };
    line(widths.iter().enumerate().map(rule).collect());
    for row in rows {
        let mut cells = row.clone();
        cells.resize(head.len(), String::new());
        line(cells);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_stand_in_line() {
        let text = table(&["stage", "ms"], &[vec!["stereo".into(), "20.1".into()], vec!["é".into()]]);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines,
            ["| stage  |   ms |", "| ------ | ---: |", "| stereo | 20.1 |", "| é      |      |"]
        );
    }
}
