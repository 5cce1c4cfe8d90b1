"""The page of a calibration: numbers for reading, pictures, template; and the summary for a terminal."""
