"""The unknown law: where no kind of the catalogue fits, a curve over one coordinate is learned and judged."""
