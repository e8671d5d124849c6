"""The methods to compare with, and the batch that bounds them all."""
