"""Motions along paths: through poses, with a time law, as fast as the limits allow."""
