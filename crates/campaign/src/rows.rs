//! A table row by row, whatever it is written in.

use super::error::CampaignError;
use csv::ByteRecord;

/// Rows of a table, from its header on.
pub(super) trait Rows {
    /// Reads the next row that is no comment and not blank into `record`; its row number, or none at the end.
    fn next(&mut self, record: &mut ByteRecord) -> Result<Option<usize>, CampaignError>;
}
