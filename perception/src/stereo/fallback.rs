//! Fallback for a matcher on a device: another matcher replaces it when the device is lost.

use super::device::{DeviceState, Loss};
use super::matcher::{MatchError, MatchOutput, Matcher, MatcherError};
use crate::image::GreyView;

/// Creates the matcher that replaces a lost one.
pub type Replacement = Box<dyn FnMut() -> Result<Box<dyn Matcher>, MatcherError>>;

/// A matcher on a device with a replacement for when the device is lost. The replacement starts with the pair
/// during which the device was lost, so no pair is dropped.
pub struct Fallback {
    device: Option<Box<dyn Matcher>>,
    adapter: String,
    driver: String,
    loss: Option<Loss>,
    replacement: Replacement,
    other: Option<Box<dyn Matcher>>,
}

impl Fallback {
    /// Uses `device` until it is lost, then the matcher that `replacement` creates.
    pub fn new(device: Box<dyn Matcher>, replacement: Replacement) -> Self {
        let (adapter, driver) =
            device.device().map(|d| (d.adapter.to_owned(), d.driver.to_owned())).unwrap_or_default();
        Self { device: Some(device), adapter, driver, loss: None, replacement, other: None }
    }

    fn current(&self) -> Option<&dyn Matcher> {
        self.device.as_deref().or(self.other.as_deref())
    }
}

impl Matcher for Fallback {
    fn compute_within(
        &mut self,
        left: GreyView<'_>,
        right: GreyView<'_>,
        output: MatchOutput<'_>,
        go_on: &mut (dyn FnMut() -> bool + Send),
    ) -> Result<u32, MatchError> {
        let MatchOutput { disparity, confidence } = output;
        if let Some(device) = &mut self.device {
            let output = MatchOutput { disparity: &mut *disparity, confidence: &mut *confidence };
            match device.compute_within(left, right, output, go_on) {
                Err(MatchError::Lost(loss)) => {
                    self.loss = Some(loss);
                    self.device = None;
                }
                done => return done,
            }
        }
        let other = match &mut self.other {
            Some(other) => other,
            // The replacement accepts every size that the device accepts; if it fails, the loss is reported.
            none => match ((self.replacement)(), self.loss) {
                (Ok(made), _) => none.insert(made),
                (Err(_), loss) => return Err(MatchError::Lost(loss.unwrap_or(Loss::Device))),
            },
        };
        other.compute_within(left, right, MatchOutput { disparity, confidence }, go_on)
    }

    fn nodes(&self) -> usize {
        self.current().map_or(0, Matcher::nodes)
    }

    fn workspace_bytes(&self) -> usize {
        self.current().map_or(0, Matcher::workspace_bytes)
    }

    fn device(&self) -> Option<DeviceState<'_>> {
        match &self.device {
            Some(device) => device.device(),
            None => Some(DeviceState {
                adapter: &self.adapter,
                driver: &self.driver,
                stages: &[],
                loss: self.loss,
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Writes its number to the whole map, and reports a loss after some pairs.
    struct Numbered {
        number: u16,
        pairs_left: Option<usize>,
    }

    impl Matcher for Numbered {
        fn compute_within(
            &mut self,
            _: GreyView<'_>,
            _: GreyView<'_>,
            output: MatchOutput<'_>,
            _: &mut (dyn FnMut() -> bool + Send),
        ) -> Result<u32, MatchError> {
            if let Some(left) = &mut self.pairs_left {
                *left = left.checked_sub(1).ok_or(MatchError::Lost(Loss::Hung))?;
            }
            output.disparity.fill(self.number);
            Ok(0)
        }

        fn nodes(&self) -> usize {
            self.number.into()
        }

        fn workspace_bytes(&self) -> usize {
            0
        }

        fn device(&self) -> Option<DeviceState<'_>> {
            Some(DeviceState { adapter: "card", driver: "driver", stages: &[], loss: None })
        }
    }

    #[test]
    fn the_replacement_matches_the_failed_pair_and_all_later_pairs() {
        let mut made = 0;
        let replacement: Replacement = Box::new(move || {
            made += 1;
            assert_eq!(made, 1, "one replacement is enough");
            Ok(Box::new(Numbered { number: 2, pairs_left: None }))
        });
        let device = Numbered { number: 1, pairs_left: Some(2) };
        let mut matcher = Fallback::new(Box::new(device), replacement);
        let pixels = [0; 64];
        let view = GreyView::new(&pixels, 8, 8, 8).unwrap();
        let mut got = Vec::new();
        for _ in 0..4 {
            let (mut disparity, mut confidence) = ([0; 64], [0; 64]);
            let output = MatchOutput { disparity: &mut disparity, confidence: &mut confidence };
            matcher.compute(view, view, output).unwrap();
            got.push((disparity[0], matcher.nodes(), matcher.device().unwrap().loss));
        }
        assert_eq!(got[..2], [(1, 1, None); 2]);
        assert_eq!(got[2..], [(2, 2, Some(Loss::Hung)); 2]);
        assert_eq!(matcher.device().unwrap().adapter, "card");
    }
}
