//! Words of a surface group: products of side pairings of a polygon, as numbers.
//!
//! Whether two words are one element is decided exactly, by Dehn's algorithm: a word that is longer than it need be has a part that is
//! more than half of the relator (Dehn 1912; Lyndon & Schupp, *Combinatorial Group Theory*, 1977, chapter V).

use smallvec::SmallVec;

use crate::toroidal::DeckGroup;

/// A generator, numbered from 1, or with a minus its inverse.
pub type Letter = i8;

/// A product of letters, the last of which is applied first.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub(crate) struct Word(pub SmallVec<[Letter; 14]>);

impl Word {
    pub fn is_identity(&self) -> bool {
        self.0.is_empty()
    }

    pub fn letter(letter: Letter) -> Self {
        Self(SmallVec::from_slice(&[letter]))
    }

    /// Appends a letter, or takes away its inverse.
    fn push(&mut self, letter: Letter) {
        match self.0.last() {
            Some(&last) if last == -letter => {
                self.0.pop();
            }
            _ => self.0.push(letter),
        }
    }

    /// The product without its part that cancels; not yet shortened by the relator.
    pub fn times(&self, other: &Self) -> Self {
        let mut product = self.clone();
        other.0.iter().for_each(|&letter| product.push(letter));
        product
    }

    pub fn inverted(&self) -> Self {
        Self(self.0.iter().rev().map(|letter| -letter).collect())
    }
}

/// A product of letters that is the identity, and has every generator and its inverse once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Relator {
    letters: Vec<Letter>,
    /// By letter, shifted by the number of generators: the one after it, in the relator and in its inverse.
    after: [Vec<Letter>; 2],
}

impl Relator {
    /// `None` unless the letters are those of generators `1..=2g` and their inverses, `g ≥ 2`, each once.
    pub fn new(letters: &[Letter]) -> Option<Self> {
        let generators = letters.len() / 2;
        let is_complete = letters.len() >= 8 && letters.len().is_multiple_of(4) && generators < Letter::MAX as usize;
        let mut sorted = letters.to_vec();
        sorted.sort_unstable();
        let all = (-(generators as i64)..=generators as i64).filter(|&letter| letter != 0);
        if !is_complete || !sorted.iter().map(|&letter| i64::from(letter)).eq(all) {
            return None;
        }
        let mut after = [(); 2].map(|()| vec![0; 2 * generators + 1]);
        let place = |letter: Letter| (i64::from(letter) + generators as i64) as usize;
        for (&a, &b) in letters.iter().zip(letters.iter().cycle().skip(1)) {
            after[0][place(a)] = b;
            after[1][place(-b)] = -a;
        }
        Some(Self {
            letters: letters.to_vec(),
            after,
        })
    }

    pub fn letters(&self) -> &[Letter] {
        &self.letters
    }

    pub fn generators(&self) -> usize {
        self.letters.len() / 2
    }

    fn after(&self, direction: usize, letter: Letter) -> Letter {
        self.after[direction][(i64::from(letter) + self.generators() as i64) as usize]
    }

    /// The same element by a word without a part that is more than half of the relator; the identity is the empty word.
    pub fn shortened(&self, word: Word) -> Word {
        let (length, mut word) = (self.letters.len(), word);
        'again: loop {
            for direction in 0..2 {
                let mut begin = 0;
                while begin < word.0.len() {
                    let mut end = begin + 1;
                    while end < word.0.len()
                        && end - begin < length
                        && word.0[end] == self.after(direction, word.0[end - 1])
                    {
                        end += 1;
                    }
                    if end - begin > length / 2 {
                        // The rest of the relator, backwards.
                        let mut rest = SmallVec::<[Letter; 14]>::new();
                        let mut letter = word.0[end - 1];
                        for _ in end - begin..length {
                            letter = self.after(direction, letter);
                            rest.push(-letter);
                        }
                        let mut shorter = Word(SmallVec::from_slice(&word.0[..begin]));
                        rest.iter().rev().for_each(|&letter| shorter.push(letter));
                        word.0[end..].iter().for_each(|&letter| shorter.push(letter));
                        word = shorter;
                        continue 'again;
                    }
                    // A part that starts later within this run is no longer.
                    begin = end;
                }
            }
            return word;
        }
    }
}

/// Elements are shortened words.
impl DeckGroup for std::sync::Arc<Relator> {
    type Element = Word;

    fn identity(&self) -> Word {
        Word::default()
    }

    fn product(&self, a: &Word, b: &Word) -> Word {
        match (a.is_identity(), b.is_identity()) {
            (true, _) => b.clone(),
            (_, true) => a.clone(),
            _ => self.shortened(a.times(b)),
        }
    }

    fn inverse(&self, a: &Word) -> Word {
        a.inverted()
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng, rngs::StdRng};

    use super::*;

    /// `a b a⁻¹ b⁻¹ c d c⁻¹ d⁻¹ …`
    fn standard(genus: i8) -> Relator {
        let of_handle = |k: i8| {
            let (a, b) = (2 * k + 1, 2 * k + 2);
            [a, b, -a, -b]
        };
        Relator::new(&(0..genus).flat_map(of_handle).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn products_of_conjugates_of_the_relator_are_the_identity() {
        let mut rng = StdRng::seed_from_u64(3);
        for genus in [2, 3, 5] {
            let relator = standard(genus);
            for _ in 0..200 {
                let mut word = Word::default();
                for _ in 0..rng.random_range(1..4) {
                    let letters = 2 * genus;
                    let any = |rng: &mut StdRng| {
                        let letter = rng.random_range(1..=letters);
                        if rng.random_bool(0.5) { letter } else { -letter }
                    };
                    let by = Word((0..rng.random_range(0..6)).map(|_| any(&mut rng)).collect());
                    let own = Word(SmallVec::from_slice(relator.letters()));
                    let own = if rng.random_bool(0.5) { own } else { own.inverted() };
                    word = word.times(&by).times(&own).times(&by.inverted());
                }
                assert!(relator.shortened(word.clone()).is_identity(), "{word:?}");
                assert!(!relator.shortened(word.times(&Word::letter(1))).is_identity());
            }
        }
    }

    #[test]
    fn other_lists_of_letters_are_no_relators() {
        for letters in [&[1, 2, -1, -2][..], &[1, 2, -1, -2, 3, 4, -3, 4], &[1, 2, 3], &[]] {
            assert_eq!(Relator::new(letters), None, "{letters:?}");
        }
    }
}
