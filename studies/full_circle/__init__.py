"""From records to a design that was tried: identified, diagnosed, redesigned, run; on own axes and withheld ones."""
