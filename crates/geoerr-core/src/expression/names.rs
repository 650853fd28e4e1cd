//! Names: which can stand in a formula, and which resemble one another.

/// Whether a text can stand in a formula as a name.
pub(super) fn is_name(text: &str) -> bool {
    let mut bytes = text.bytes();
    bytes.next().is_some_and(|first| first.is_ascii_alphabetic() || first == b'_')
        && bytes.all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
}

/// Names longer than this are not compared: the work grows with the square of the length.
const COMPARED: usize = 40;
/// How many resembling names are offered.
const OFFERED: usize = 3;

/// Known names within a few letters of `name`, nearest first.
pub(super) fn near(name: &str, known: &[String]) -> Vec<String> {
    let allowed = match name.len() {
        0..=1 => 0,
        2..=4 => 1,
        _ => 2,
    };
    let mut found: Vec<(usize, &String)> = known
        .iter()
        .filter(|candidate| candidate.len().max(name.len()) <= COMPARED)
        .map(|candidate| {
            let is_same = candidate.eq_ignore_ascii_case(name);
            (if is_same { 0 } else { edits(name.as_bytes(), candidate.as_bytes()) }, candidate)
        })
        .filter(|&(distance, candidate)| {
            // A name of one letter is one edit away from every other: it must be that letter.
            let shares = candidate.as_bytes().first() == name.as_bytes().first();
            distance <= allowed && (distance < candidate.len() || shares)
        })
        .collect();
    found.sort();
    // Where only the case differs there is nothing to guess.
    if found.first().is_some_and(|best| best.0 == 0) {
        found.retain(|candidate| candidate.0 == 0);
    }
    found.into_iter().take(OFFERED).map(|(_, candidate)| candidate.clone()).collect()
}

/// Levenshtein's distance.
fn edits(a: &[u8], b: &[u8]) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, &from) in a.iter().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, &to) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(from != to);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}
