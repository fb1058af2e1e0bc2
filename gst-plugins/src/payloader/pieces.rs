//! Updates beside the packets: their pieces, and when each is due.
//!
//! It is the library's sender, which here sends no packets: these are planned by the encoder.

use nvsprior::modem::{
    Loss, ModemError, Protection, RateControlOptions, Report, Sender, SenderOptions, UpdateOptions,
};

use crate::update_event::{Answer, SentUpdate, UpdateName};

/// The link that pieces go over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PieceLink {
    pub bit_rate: f64,
    pub mtu: usize,
    pub overhead: usize,
    pub loss: Loss,
    pub stream: u8,
    /// Part of the bit rate that an update gets while it is sent.
    pub share: f64,
    pub expect_reports: bool,
}

/// Ten times this long after an update's last piece a report tells what is missing of it, seconds.
const LATENCY: f64 = 1.0;
/// Bytes of updates that are kept.
const MEMORY: usize = 1 << 18;

impl PieceLink {
    fn sender(&self) -> Result<Sender, ModemError> {
        let PieceLink { bit_rate, mtu, overhead, loss, stream, share, expect_reports } = *self;
        let plain = UpdateOptions::default();
        let updates = UpdateOptions { share, repeat: plain.repeat.min(share), memory: MEMORY };
        Sender::new(SenderOptions {
            control: RateControlOptions {
                bit_rate,
                mtu,
                overhead,
                latency: LATENCY,
                delay: 0.0,
                spread: 0.0,
                frame_rate: 1.0,
                min_bytes: 0,
                max_shares: 16,
                loss,
                user: None,
            },
            stream,
            protection: Protection::Layers,
            expect_reports,
            updates: Some(updates),
        })
    }

    /// Whether a sender for the other link can go on with this one.
    fn is_like(&self, other: &PieceLink) -> bool {
        let PieceLink { bit_rate, loss, .. } = *self;
        *self == PieceLink { bit_rate, loss, ..*other }
    }
}

/// The updates of a dive.
#[derive(Default)]
pub struct Pieces {
    /// `None`: no packet has told of the link yet.
    sending: Option<(PieceLink, Sender)>,
    /// What the sender has.
    taken: Vec<SentUpdate>,
    /// Updates for the next sender.
    early: Vec<SentUpdate>,
    /// What was told of the link, and of what is held.
    told: (Option<Answer>, Option<UpdateName>),
    refused: Vec<UpdateName>,
    /// Why the last of them was.
    refusal: Option<ModemError>,
}

impl Pieces {
    /// Goes on over a link, from `now` on, seconds.
    pub fn follow(&mut self, now: f64, link: PieceLink) -> Result<(), ModemError> {
        match &mut self.sending {
            Some((known, _)) if *known == link => return Ok(()),
            Some((known, sender)) if known.is_like(&link) => {
                sender.set_bit_rate(now, link.bit_rate)?;
                sender.set_loss(link.loss)?;
                *known = link;
                return Ok(());
            }
            _ => {}
        }
        let sender = link.sender()?;
        self.restart();
        self.sending = Some((link, sender));
        for update in std::mem::take(&mut self.early) {
            self.push(now, update);
        }
        Ok(())
    }

    /// Begins anew with the next link, whose times may be other ones. What is held stays held.
    pub fn restart(&mut self) {
        let held = self.held();
        let held = self.taken.iter().position(|update| Some(update.name) == held);
        let again = |(index, update)| {
            let held = held.is_some_and(|held| index <= held);
            SentUpdate { held, ..update }
        };
        let early = std::mem::take(&mut self.early);
        let taken = std::mem::take(&mut self.taken).into_iter().enumerate().map(again);
        self.early = taken.chain(early).collect();
        self.sending = None;
    }

    /// Takes an update at `now`, seconds. One that cannot be sent is refused.
    pub fn push(&mut self, now: f64, update: SentUpdate) {
        let Some((_, sender)) = &mut self.sending else {
            self.early.push(update);
            return;
        };
        // A flush may have brought it twice.
        if self.taken.iter().any(|taken| taken.name == update.name) {
            return;
        }
        let pushed = match update.held {
            true => sender.push_held_update(now, &update.bytes),
            false => sender.push_update(now, &update.bytes),
        };
        if let Err(error) = pushed {
            self.refused.push(update.name);
            self.refusal = Some(error);
            return;
        }
        // It takes the place of those from its number on.
        self.taken.retain(|taken| taken.name.number < update.name.number);
        self.taken.push(update);
    }

    /// Whether an update was refused, and nobody was told.
    pub fn has_refused(&self) -> bool {
        self.refusal.is_some()
    }

    /// Why an update was refused, once.
    pub fn take_refusal(&mut self) -> Option<ModemError> {
        self.refusal.take()
    }

    /// When the next piece is due, seconds.
    pub fn due(&self) -> Option<f64> {
        self.sending.as_ref()?.1.due()
    }

    /// The next piece, if it is due at `now`.
    pub fn next(&mut self, now: f64) -> Option<Vec<u8>> {
        let (_, piece) = self.sending.as_mut()?.1.next(now)?;
        Some(piece.to_vec())
    }

    /// Takes a topside's report that came at `now`, seconds.
    pub fn report(&mut self, now: f64, bytes: &[u8]) -> Result<(), ModemError> {
        let (report, _) = Report::read(bytes)?;
        let (_, sender) = self.sending.as_mut().ok_or(ModemError::NoUpdates)?;
        sender.process_report(now, &report).map(drop)
    }

    /// The newest update that the topside holds, as far as is known.
    fn held(&self) -> Option<UpdateName> {
        let number = self.sending.as_ref()?.1.held_update()?;
        self.taken.iter().map(|update| update.name).find(|name| name.number == number)
    }

    /// The encoder is to hear all of it again.
    pub fn tell_again(&mut self) {
        self.told = (None, None);
    }

    /// What the encoder is to know, and does not yet.
    pub fn answers(&mut self) -> Vec<Answer> {
        let refused = std::mem::take(&mut self.refused).into_iter().map(Answer::Refused);
        let link = self.sending.as_ref().and_then(|(_, sender)| {
            let (share, price) = (sender.update_share(), sender.update_price()?);
            Some(Answer::Link { share, price })
        });
        let held = self.held();
        let new_link = link.filter(|_| link != self.told.0);
        let new_held = held.filter(|_| held != self.told.1);
        self.told = (link, held);
        let new_held = new_held.map(|name| Answer::Held { name, over_link: true });
        new_link.into_iter().chain(refused).chain(new_held).collect()
    }
}

#[cfg(test)]
mod tests;
